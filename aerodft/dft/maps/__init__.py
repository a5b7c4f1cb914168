"""Ground geometry of every pixel of an image: depth map, range standard deviation, ground points, orthophoto."""

from aerodft.dft.maps.depth import DepthMap, Z, depth_map, measured_plane, range_std
from aerodft.dft.maps.ground_points import GroundMap, ground_covariances
from aerodft.dft.maps.orthophoto import Sampling, TopView, top_view
