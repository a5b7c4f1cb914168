"""Widths between two banks, in one image and over a reach seen in many."""

from aerodft.dft.river.reach import ReachWidths, SeenWidths, fuse
from aerodft.dft.river.widths import BankPair, RiverWidths, river_widths
