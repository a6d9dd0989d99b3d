"""Intervals, scales of QoC, what counts as one observation, and other statistics that studies share."""
