"""Image pairs of points on the ground, projected from true poses: what a tracker would see, without images."""

import numpy as np

from aerodft.geometry import from_rotation_vector, inverse, matrix, multiply, to_rotation_vector
from aerodft.model import Camera, GimbalSource, ReportFrame
from aerodft.service.attitude import AttitudeHistory, AttitudeSeries
from aerodft.sim.trajectory import Trajectory, heading_wxyz
from aerodft.vision.camera_motion import ImagePair
from aerodft.vision.camera_motion.rotation import Matches, matches_of

CAMERA = Camera(name="views", width_px=640, height_px=360, fx_px=532.0, fy_px=532.0, cx_px=319.5, cy_px=179.5)
REPORT_HZ = 20.0
AROUND_NS = 10_000_000  # on both sides, of a rate


def seen_pair(
    earlier: Trajectory, later: Trajectory, rng, *, count=150, noise_px=0.1, flow_m=(0.0, 0.0, 0.0)
) -> Matches:
    """Points of the plane at height 0 in two images; those right of the middle moved by ``flow_m`` (ENU) meanwhile."""
    first, second = matrix(earlier.enu_wxyz_cam[0]), matrix(later.enu_wxyz_cam[0])
    pixels = rng.uniform([0, 0], [CAMERA.width_px - 1, CAMERA.height_px - 1], (count, 2))
    rays = np.column_stack([(pixels - [CAMERA.cx_px, CAMERA.cy_px]) / CAMERA.fx_px, np.ones(count)]) @ first.T
    down = rays[:, 2] < -0.05
    rays, pixels = rays[down], pixels[down]
    ground = earlier.position_enu_m[0] - rays * (earlier.position_enu_m[0, 2] / rays[:, 2])[:, None]
    ground = ground + np.where(pixels[:, :1] > CAMERA.cx_px, 1.0, 0.0) * np.asarray(flow_m)
    there = (ground - later.position_enu_m[0]) @ second
    ahead = there[:, 2] > 0.1
    moved = there[ahead, :2] / there[ahead, 2:] * CAMERA.fx_px + [CAMERA.cx_px, CAMERA.cy_px]
    moved = moved + noise_px * rng.standard_normal(moved.shape)
    return matches_of(CAMERA, pixels[ahead], moved)


def seen_flight(trajectory: Trajectory, utc_ns: np.ndarray, stamps_ns: np.ndarray, seed: int) -> list[ImagePair]:
    """Pairs of successive images that were taken at ``utc_ns`` and stamped ``stamps_ns``."""
    rng = np.random.default_rng([seed, 7])
    at = [trajectory.at([moment]) for moment in utc_ns.tolist()]
    return [
        ImagePair(start_ns=int(stamps_ns[k]), end_ns=int(stamps_ns[k + 1]), matches=seen_pair(at[k], at[k + 1], rng))
        for k in range(len(at) - 1)
    ]


def _against(at: Trajectory, *, in_earth: bool) -> np.ndarray:
    return multiply(heading_wxyz(at.ned_wxyz_body), at.level_wxyz_gimbal) if in_earth else at.level_wxyz_gimbal


def reported(
    trajectory: Trajectory,
    *,
    lag_s: float,
    time_constant_s: float = 0.0,
    noise_rad: float = 0.0,
    in_earth: bool = False,
    seed: int = 0,
) -> AttitudeHistory:
    """What a log of the flight says: the gimbal ``lag_s`` early, against the vehicle's heading or north.

    So much of the lag is that of a camera that turns the faster, the farther it is from the report.
    """
    rng = np.random.default_rng([seed, 8])
    stamps = np.arange(trajectory.start_ns, trajectory.end_ns, round(1e9 / REPORT_HZ), dtype=np.int64)
    after_ns = round((lag_s - time_constant_s) * 1e9)
    before, gimbal, after = (
        _against(trajectory.at(stamps + after_ns + sign * AROUND_NS), in_earth=in_earth) for sign in (-1, 0, 1)
    )
    rate_radps = to_rotation_vector(multiply(inverse(before), after)) / (2e-9 * AROUND_NS)
    gimbal = multiply(gimbal, from_rotation_vector(time_constant_s * rate_radps))
    gimbal = multiply(gimbal, from_rotation_vector(noise_rad * rng.standard_normal((len(stamps), 3))))
    earth = np.full(len(stamps), float(in_earth))
    return AttitudeHistory(
        vehicle=AttitudeSeries(
            stamp_ns=stamps, wxyz=trajectory.at(stamps).ned_wxyz_body, yaw_in_earth=np.ones(len(stamps))
        ),
        gimbals={GimbalSource.GIMBAL_DEVICE: AttitudeSeries(stamp_ns=stamps, wxyz=gimbal, yaw_in_earth=earth)},
        frames={GimbalSource.GIMBAL_DEVICE: ReportFrame.EARTH},
    )
