"""Pictures by a camera that turns, made of one picture by OpenCV's own lens model, with noise, light and passers-by."""

from pathlib import Path

import cv2
import numpy as np

from aerodft.geometry import from_rotation_vector, inverse, multiply, to_rotation_vector
from aerodft.model import Camera, Image

BRIDGE = Path(__file__).parents[2] / "configs/calibration/bridge.jpg"
CAMERA = Camera(
    name="small",
    width_px=960,
    height_px=540,
    fx_px=790.0,
    fy_px=802.0,
    cx_px=484.0,
    cy_px=262.0,
    distortion=(-0.18, 0.05, 0.0012, -0.0007),
)
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 20, 1e-8)


def scene():
    """``(540, 960, 3)``: what the camera sees before anything happens."""
    picture = cv2.imread(str(BRIDGE))
    assert picture is not None
    return cv2.resize(picture, (CAMERA.width_px, CAMERA.height_px), interpolation=cv2.INTER_AREA)


def after_turn(picture, rotvec, camera=CAMERA):
    """What it sees after a rotation ``later_SO3_earlier``."""
    if not np.any(rotvec):
        return picture.copy()
    intrinsics = np.array([[camera.fx_px, 0.0, camera.cx_px], [0.0, camera.fy_px, camera.cy_px], [0.0, 0.0, 1.0]])
    distortion = np.array(camera.distortion or (0.0, 0.0, 0.0, 0.0))
    columns, rows = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    pixels = np.stack([columns, rows], axis=-1).astype(np.float64).reshape(-1, 1, 2)
    flat = cv2.undistortPoints(pixels, intrinsics, distortion, criteria=STOP)
    rays = np.concatenate([flat, np.ones((len(flat), 1, 1))], axis=-1)
    back = -np.asarray(rotvec, dtype=np.float64)
    source = cv2.projectPoints(rays, back, np.zeros(3), intrinsics, distortion)[0]
    source = source.reshape(camera.height_px, camera.width_px, 2).astype(np.float32)
    return cv2.remap(picture, source, np.empty(0, np.float32), cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REFLECT_101)


def as_taken(picture, rng, *, gain=1.0, offset=0.0, noise=3.0, quality=85):
    """With the light, the noise and the JPEG of a real camera."""
    lit = np.clip(picture * gain + offset + rng.normal(scale=noise, size=picture.shape), 0, 255).astype(np.uint8)
    return cv2.imdecode(cv2.imencode(".jpg", lit, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_COLOR)


def with_passers_by(picture, rng, share=0.4):
    """Patches of the picture itself, moved at random, over a share of it."""
    moved, covered = picture.copy(), np.zeros(picture.shape[:2], dtype=bool)
    while covered.mean() < share:
        width, height = rng.integers(60, 180), rng.integers(40, 120)
        to = rng.integers([0, 0], [picture.shape[1] - width, picture.shape[0] - height])
        of = np.clip(to + rng.integers(-40, 41, size=2), 0, [picture.shape[1] - width, picture.shape[0] - height])
        moved[to[1] : to[1] + height, to[0] : to[0] + width] = picture[of[1] : of[1] + height, of[0] : of[0] + width]
        covered[to[1] : to[1] + height, to[0] : to[0] + width] = True
    return moved


def image_of(picture, index=0):
    """As an observer is shown it, one a second."""
    height, width = picture.shape[:2]
    stamp_ns = 1_795_221_168_000_000_000 + index * 1_000_000_000
    return Image(
        index=index,
        stamp_ns=stamp_ns,
        arrival_ns=stamp_ns,
        width_px=width,
        height_px=height,
        pixels=lambda: picture,
    )


def pairs_of(observation):
    """Pixels ``(n, 2)`` in the reference, and now."""
    pairs = np.array(observation.pixels, dtype=np.float64).reshape(-1, 2, 2)
    return pairs[:, 0], pairs[:, 1]


def error_rad(wxyz, rotvec):
    """From an estimate to the true rotation, about the camera's axes now."""
    return to_rotation_vector(multiply(from_rotation_vector(np.asarray(rotvec, dtype=np.float64)), inverse(wxyz)))
