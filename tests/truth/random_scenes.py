"""Random scenes with their truth, and what is said of them: pose and pixels that are off as the stated stds say."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from aerodft.dft import Request
from aerodft.model import Camera, Probe, ProbeKind

from .scenes import as_pixels, camera_axes, depression_rad, opencv_pixels, opencv_rays, sample_of

WIDTH_PX, HEIGHT_PX = 1920, 1080
MARGIN_PX = 15.0  # true pixels stay so far inside that noisy ones are in the image, too
APART_PX = (30.0, 500.0)  # of a probe's pixels from its first: closer together, noise is all that there is to measure
TOP = 3  # row of the object's top; the rows before it are ground points
PIXELS = {
    "range": (ProbeKind.RANGE, [0]),
    "position": (ProbeKind.POSITION, [0]),
    "distance": (ProbeKind.DISTANCE, [0, 1]),
    "width": (ProbeKind.WIDTH, [0, 1]),
    "length": (ProbeKind.LENGTH, [0, 1, 2]),
    "area": (ProbeKind.AREA, [0, 1, 2]),
    "height": (ProbeKind.HEIGHT, [0, TOP]),
    "bearing": (ProbeKind.BEARING, [0]),
    "bearing of two": (ProbeKind.BEARING, [0, 1]),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """How well things are known."""

    angle_deg: float
    height_share: float
    std_px: float

    def __str__(self):
        return f"{self.angle_deg:g} deg, {self.height_share:.0%}, {self.std_px:g} px"


@dataclass(frozen=True, slots=True)
class Scene:
    """What is really there: three ground points and an object that stands on the first; pixels of the four in order."""

    camera: Camera
    axes_enu: np.ndarray
    height_m: float
    points_m: np.ndarray
    object_m: float
    pixels_px: np.ndarray


def random_camera(rng):
    focal = rng.uniform(1200, 2400)
    return Camera(
        name="random", width_px=WIDTH_PX, height_px=HEIGHT_PX, fx_px=focal, fy_px=focal * rng.uniform(0.97, 1.03),
        cx_px=960 + rng.uniform(-40, 40), cy_px=540 + rng.uniform(-40, 40),
        distortion=tuple(rng.uniform(-1, 1, 5) * [0.1, 0.02, 2e-3, 2e-3, 5e-3]),
    )  # fmt: skip


def random_scene(rng, below_rad):
    """A scene whose first point is seen ``below_rad`` below the horizon."""
    while True:
        camera, heading, roll = random_camera(rng), rng.uniform(0, 2 * math.pi), rng.normal() * math.radians(20)
        first = rng.uniform([60, 60], [WIDTH_PX - 60, HEIGHT_PX - 60])
        turn = rng.uniform(0, 2 * math.pi, TOP - 1)
        apart = np.exp(rng.uniform(*np.log(APART_PX), (TOP - 1, 1))) * np.column_stack([np.cos(turn), np.sin(turn)])
        rays = opencv_rays(camera, np.vstack([first, first + apart, first - apart]))
        axes = _axes(rays[0], below_rad, roll, heading)
        if axes is None:
            continue
        rays_enu = rays @ axes.T
        below = depression_rad(rays_enu)
        lower = [row if below[row] > below[row + TOP - 1] else row + TOP - 1 for row in range(1, TOP)]
        scene = _built(rng, camera, axes, rays_enu[[0, *lower]])
        if scene is not None:
            return scene


def _axes(ray_cam, below_rad, roll_rad, heading_rad):
    """The attitude that has a ray so far below the horizon; None where this roll and heading have none."""
    x, y, z = ray_cam / np.linalg.norm(ray_cam)
    lower = math.sin(roll_rad) * x + math.cos(roll_rad) * y
    most = math.hypot(lower, z)
    if math.sin(below_rad) > most:
        return None
    return camera_axes(math.atan2(lower, z) + math.acos(math.sin(below_rad) / most), roll_rad, heading_rad)


def _built(rng, camera, axes, rays_enu):
    """The scene on the ground; None where something of it is out of the image."""
    if np.any(rays_enu[:, 2] >= 0):
        return None
    height = rng.uniform(5, 300)
    position = np.array([0.0, 0.0, height])
    points = position - height / rays_enu[:, 2:] * rays_enu
    tall = rng.uniform(0.02, 0.2) * math.dist(points[0], position)
    seen = np.vstack([points, points[0] + [0, 0, tall]]) - position
    if np.any(seen @ axes[:, 2] <= 0.3 * np.linalg.norm(seen, axis=1)):
        return None
    pixels = opencv_pixels(camera, axes, position, seen + position)
    inside = np.all((pixels > MARGIN_PX) & (pixels < [WIDTH_PX - MARGIN_PX, HEIGHT_PX - MARGIN_PX]))
    return Scene(camera, axes, height, points, tall, pixels) if inside else None


@dataclass(frozen=True, slots=True)
class Said:
    """What the engine is told of a scene."""

    scene: Scene
    level: Level
    axes_enu: np.ndarray
    height_m: float
    elevation_m: float
    pixels_px: np.ndarray

    @classmethod
    def of(cls, rng, scene, level):
        """Errors as stated; and how high the plane really is on which a width is measured."""
        height = scene.height_m / (1 + level.height_share * rng.normal())
        off = Rotation.from_rotvec(rng.normal(size=3) * math.radians(level.angle_deg)).as_matrix()
        pixels = scene.pixels_px + rng.normal(size=scene.pixels_px.shape) * level.std_px
        elevation = rng.uniform(-0.2, 0.3) * height
        said = cls(scene, level, scene.axes_enu @ off, height, elevation, pixels)
        return said, elevation + said.height_std_m * rng.normal()

    @property
    def height_std_m(self):
        return self.level.height_share * self.height_m

    @property
    def sample(self):
        angle = math.radians(self.level.angle_deg)
        cov = np.diag([0.0, 0.0, self.height_std_m**2, angle**2, angle**2, angle**2])
        return sample_of(self.axes_enu, [0.0, 0.0, self.height_m], cov)

    def request(self, name):
        kind, rows = PIXELS[name]
        pixels = as_pixels(self.pixels_px[rows])
        plane = {"elevation_m": self.elevation_m, "elevation_std_m": self.height_std_m} if name == "width" else {}
        return Request(
            probe=Probe(name=name, kind=kind, pixels=pixels, **plane), pixels=pixels, std_px=self.level.std_px
        )


def truths(scene, elevation_m):
    """The true value of each probe; the width's plane is at ``elevation_m``."""
    points, camera = scene.points_m, np.array([0.0, 0.0, scene.height_m])
    x, y, _ = points.T
    steps = np.hypot(np.diff(x), np.diff(y))
    return {
        "range": math.dist(points[0], camera),
        "position": points[0, :2],
        "distance": steps[0],
        "width": steps[0] * (1 - elevation_m / scene.height_m),  # similar triangles
        "length": steps.sum(),
        "area": abs((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])) / 2,
        "height": scene.object_m,
        "bearing": math.degrees(math.atan2(x[0], y[0])),
        "bearing of two": math.degrees(math.atan2(x[1] - x[0], y[1] - y[0])),
    }
