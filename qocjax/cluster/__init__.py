"""Chunks of a study on other processes and machines, through Dask (the extra `cluster`)."""

from qocjax.cluster.engine import DaskEngine

__all__ = ["DaskEngine"]
