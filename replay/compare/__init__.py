"""Comparison of two recordings: which measurements belong together, and how far they deviate."""

from replay.compare.comparison import (
    MAX_STAMP_GAP_S,
    Comparison,
    Difference,
    Pairs,
    Tolerance,
    compare_measurements,
    parse_tolerance,
)
from replay.compare.pairing import PairBy
