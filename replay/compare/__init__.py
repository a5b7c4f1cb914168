"""Two recordings side by side: the same measurements, and how far apart they are."""

from replay.compare.comparison import WITHIN_S, Comparison, ComparisonRun, Difference, Pairs, Tolerance, parse_tolerance
from replay.compare.pairing import PairBy
