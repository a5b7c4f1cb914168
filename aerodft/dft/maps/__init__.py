"""Ground geometry of every pixel of an image: depth map, range standard deviation, ground points, orthophoto."""

from aerodft.dft.maps.depth import DepthMap, GroundMap, Z, depth_map, ground_covariances, plane_at_elevation, range_std
from aerodft.dft.maps.orthophoto import Sampling, TopView, top_view
