"""Pure array functions: rotations, lens, rays, ground, geodesy. Batch-first, no I/O, no state."""

from aerodft.geometry.footprints import footprint, horizon_line, in_image, ring_area
from aerodft.geometry.ground import Ground, GroundHits, Plane, jacobians, meet_level
from aerodft.geometry.kernels import (
    GSD,
    PITCH,
    RANGE,
    RAY_Z,
    Float32Array,
    X,
    Y,
    meet_dense,
    meet_pinhole,
)
from aerodft.geometry.lens import (
    PINHOLE_PARAMETERS,
    all_coefficients,
    axis_focal_px,
    distorted_with_jacobian,
    intrinsics_covariance,
    pixels_by_intrinsics,
    pixels_from_rays,
    rays_by_intrinsics,
    rays_from_pixels,
    rays_with_jacobian,
    reproject,
)
from aerodft.geometry.lenses import LENS_MODELS, Distorted, Lens
from aerodft.geometry.poses import (
    UNKNOWN_HEADING_VAR,
    camera_pose,
    east_north,
    extrapolate_pose,
    lat_lon,
    pose_covariance,
)
from aerodft.geometry.relative_rotation import MIN_POINTS, RelativeRotation, find_rotation, rotated_pixels
from aerodft.geometry.robust import robust_std, robust_stds, student_loss, student_weights, weighted_step
from aerodft.geometry.rotation import (
    about_axis,
    angles_of_matrix,
    camera_angles,
    camera_attitude,
    camera_from_gimbal,
    cross,
    from_rotation_vector,
    from_yaw_pitch_roll,
    gimbal_from_camera,
    inverse,
    matrix,
    multiply,
    right_jacobian,
    rotate,
    skew,
    slerp,
    to_rotation_vector,
    yaw_pitch_roll,
)
from aerodft.geometry.terrain import EARTH_RADIUS_M, STANDARD_REFRACTION, ElevationGrid, Terrain, sample_all
