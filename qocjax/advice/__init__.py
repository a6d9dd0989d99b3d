"""Advice on a network: which design to set, how far it holds, and what it rests on."""
