"""The measurement engine: Depth from Triangulation by the paper (``dft``) or by a pinhole, with joint uncertainty."""

from aerodft.dft.covariance import CHI2_2D_95, Z95, Share, advice, ellipses95, scalar_jacobians, shared_covariance
from aerodft.dft.engine import explain, measure
from aerodft.dft.equations import tilt_warning, vertical_angle
from aerodft.dft.known_points import End, at_own_heights, probe_end
from aerodft.dft.measurement_batch import NO_IMAGE, MeasurementBatch, MeasurementColumn, single_image_batch
from aerodft.dft.probe_kinds import MAX_RELATIVE_RANGE_STD, PROBE_KINDS, Kind, Refusal, recorded_kind, scalars
from aerodft.dft.projection import (
    ELEVATION,
    FOCAL,
    INTRINSICS,
    POSITION,
    PRINCIPAL_POINT,
    ROTATION,
    GroundPoints,
    ground_frame_pose,
    lat_lon_alt,
    pixel_directions,
    pixel_rays,
    project,
    shared_count,
    to_ground_frame,
)
from aerodft.dft.quantities import Gradient, RayGeometry, upright_height
from aerodft.dft.request import Request, Setup, link_requests, zoomed
from aerodft.dft.river import BankPair, Contradiction, ImageWidths, ReachWidths, RiverWidths, fuse_widths, river_widths
from aerodft.dft.silhouette import EDGE_STD_PX, Silhouette, down_in_image, locate_box, locate_outline, simplify_outline
