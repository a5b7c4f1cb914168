"""River widths between two banks, in one image and fused over the images of a reach."""

from aerodft.dft.river.reach import ImageWidths, ReachWidths, fuse_widths
from aerodft.dft.river.widths import BankPair, RiverWidths, river_widths
