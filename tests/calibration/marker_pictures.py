"""Pictures of surveyed markers in a scene, through a known lens: OpenCV undistorts every sample of a pixel."""

from dataclasses import dataclass

import cv2
import numpy as np

TEXELS = 24  # of a module
FINE = 3  # samples along each side of a pixel
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-9)


@dataclass(frozen=True)
class Lens:
    """In OpenCV's terms."""

    width: int = 1280
    height: int = 720
    focal: tuple[float, float] = (900.0, 895.0)
    centre: tuple[float, float] = (651.0, 352.0)
    distortion: tuple[float, ...] = (-0.28, 0.09, 0.0012, -0.0007)

    @property
    def matrix(self):
        return np.array([[self.focal[0], 0.0, self.centre[0]], [0.0, self.focal[1], self.centre[1]], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class View:
    """A camera at a place, level across its image: ``tilt`` from straight down, ``heading`` clockwise from north."""

    lens: Lens
    place: tuple[float, float, float]
    tilt_deg: float
    heading_deg: float

    @property
    def rotation(self):
        """``(3, 3)``: rows are the camera's right, down and ahead in east, north, up."""
        tilt, heading = np.radians([self.tilt_deg, self.heading_deg])
        level = np.array([np.sin(heading), np.cos(heading), 0.0])
        ahead = np.sin(tilt) * level - [0.0, 0.0, np.cos(tilt)]
        right = np.array([np.cos(heading), -np.sin(heading), 0.0])
        return np.stack([right, np.cross(ahead, right), ahead])

    def pixels(self, points):
        """``(n, 2)`` of points ``(n, 3)``, by OpenCV."""
        rotvec, shift = cv2.Rodrigues(self.rotation)[0], -self.rotation @ np.asarray(self.place)
        points = np.asarray(points, dtype=np.float64).reshape(-1, 1, 3)
        return cv2.projectPoints(points, rotvec, shift, self.lens.matrix, np.array(self.lens.distortion))[0][:, 0]

    def rays(self, pixels):
        """``(n, 3)`` in east, north, up of pixels ``(n, 2)``."""
        pixels = np.asarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        flat = cv2.undistortPoints(pixels, self.lens.matrix, np.array(self.lens.distortion), criteria=STOP)[:, 0]
        return np.concatenate([flat, np.ones((len(flat), 1))], axis=1) @ self.rotation


@dataclass(frozen=True)
class Printed:
    """A marker on a sheet: its centre, and the directions of its right and down edges."""

    id: int
    centre: tuple[float, float, float]
    right: tuple[float, float, float] = (1.0, 0.0, 0.0)
    down: tuple[float, float, float] = (0.0, -1.0, 0.0)
    side: float = 0.4

    @property
    def corners(self):
        """``(4, 3)``: top left, top right, bottom right, bottom left."""
        right, down = (np.array(each) / np.linalg.norm(each) * self.side / 2 for each in (self.right, self.down))
        return np.array(self.centre) + np.stack([-right - down, right - down, right + down, down - right])


def flat(marker, centre, turn_deg=0.0, side=0.4):
    """A marker that lies on the ground, its top edge turned clockwise from east."""
    turn = np.radians(turn_deg)
    right = (np.cos(turn), -np.sin(turn), 0.0)
    down = (-np.sin(turn), -np.cos(turn), 0.0)
    return Printed(marker, centre, right, down, side)


def upright(marker, centre, facing_deg, side=0.4):
    """A marker on a wall that faces a heading."""
    facing = np.radians(facing_deg)
    return Printed(marker, centre, (-np.cos(facing), np.sin(facing), 0.0), (0.0, 0.0, -1.0), side)


def picture(view, markers, dictionary="4X4_50", *, blur_px=0.7, noise=2.5, seed=0):
    """``(h, w, 3)`` uint8 BGR of markers on white sheets over uneven grey ground.

    Args:
        view: Who looks.
        markers: What is there; sheets reach one module beyond the black.
        dictionary: Of the markers.
        blur_px: Standard deviation of what the lens blurs.
        noise: Standard deviation of grey values.
        seed: Of the noise.
    """
    rng = np.random.default_rng(seed)
    lens, known = view.lens, cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, "DICT_" + dictionary))
    coarse = rng.uniform(85, 135, (lens.height // 40 + 2, lens.width // 40 + 2)).astype(np.float32)
    grey = cv2.resize(coarse, (lens.width, lens.height), interpolation=cv2.INTER_CUBIC)
    for marker in markers:
        _paint(grey, view, marker, known)
    grey = cv2.GaussianBlur(grey, (0, 0), blur_px) + rng.normal(0.0, noise, grey.shape)
    return cv2.cvtColor(np.clip(np.rint(grey), 0, 255).astype(np.uint8), cv2.COLOR_GRAY2BGR)


def _paint(grey, view, marker, known):
    modules = known.markerSize + 2
    image = cv2.aruco.generateImageMarker(known, marker.id, modules * TEXELS)
    sheet = np.pad(image, TEXELS, constant_values=255).astype(np.float32)
    corners = marker.corners
    right, down = corners[1] - corners[0], corners[3] - corners[0]
    margin = 1 / modules
    reach = np.array([[a, b] for a in (-margin, 1 + margin) for b in (-margin, 1 + margin)])
    seen = view.pixels(corners[0] + reach @ np.stack([right, down]))
    low = np.maximum(np.floor(seen.min(axis=0)).astype(int) - 2, 0)
    high = np.minimum(np.ceil(seen.max(axis=0)).astype(int) + 3, [view.lens.width, view.lens.height])
    if np.any(high <= low):
        return
    u, v = ((np.arange((high[i] - low[i]) * FINE) + 0.5) / FINE - 0.5 + low[i] for i in (0, 1))
    rays = view.rays(np.stack(np.meshgrid(u, v), axis=-1))
    axes = np.linalg.inv(np.stack([right, down, np.cross(right, down)], axis=1))
    start, along = axes @ (np.array(view.place) - corners[0]), rays @ axes.T
    at = (start[:2] - start[2] / along[:, 2:] * along[:, :2]).reshape(len(v), len(u), 2)
    texels = ((at * modules + 1) * TEXELS - 0.5).astype(np.float32)
    there = np.all((at > -margin) & (at < 1 + margin), axis=-1).astype(np.float32)
    size = tuple((high - low).tolist())
    shade = cv2.remap(sheet, texels[..., 0], texels[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    shade, there = (
        cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in (there * (25 + 0.75 * shade), there)
    )
    part = grey[low[1] : high[1], low[0] : high[0]]
    part *= 1 - there
    part += shade
