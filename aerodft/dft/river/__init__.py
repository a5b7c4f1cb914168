"""River widths: of one image with their joint covariance, and fused over the images of a reach."""

from aerodft.dft.river.contradiction import Contradiction
from aerodft.dft.river.fusion import ImageWidths, ReachWidths, fuse_widths
from aerodft.dft.river.widths import BankPair, RiverWidths, river_widths
