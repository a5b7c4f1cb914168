"""Loads what a worker of many recordings needs; workers are forked from a process that has imported this."""

import gc
from importlib import import_module
from typing import Final

from aerodft.cli.collector import without_collector

_NEEDED: Final = (
    "distributed.nanny",
    "distributed.worker",
    "aerodft.cli.recompute_many",
    "pyarrow.parquet",
    "pyproj",
    "numba.np.arraymath",  # comes with the first compiled function
)

with without_collector():
    for each in _NEEDED:
        import_module(each)
gc.freeze()
