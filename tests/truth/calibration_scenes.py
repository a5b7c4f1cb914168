"""Scenes with everything that people know about one: made by explicit rotations and OpenCV, seen with stated errors."""

import math
from dataclasses import dataclass, replace

import numpy as np

from aerodft.model import (
    Camera,
    GroundLines,
    GroundPoint,
    Horizon,
    KnownHeight,
    KnownLength,
    Landmark,
    Prior,
    SlantRange,
    Vertical,
)
from calibration.pose import State

from .scenes import camera_axes, depression_rad, opencv_pixels, opencv_rays

WIDTH_PX, HEIGHT_PX = 1920, 1080
INSIDE_PX = 30.0
LOWEST_RAD = math.radians(8.0)
"""Nobody surveys what is seen at less than this below the horizon: a pixel there is metres long."""
APART_PX = 250.0
"""Shorter lines say next to nothing."""
EARTH_RADIUS_M, REFRACTION = 6_371_000.0, 0.13
"""Of the sea's horizon: the mean radius, and the surveyors' coefficient for the bending of light."""
UP = np.array([0.0, 0.0, 1.0])


class ImpossibleError(Exception):
    """What is wanted cannot be seen from there."""


@dataclass(frozen=True, slots=True)
class World:
    """A camera above level ground, and how well things are seen and measured there.

    Positions are east, north, up; the ground is at ``elevation_m``.
    """

    camera: Camera
    tilt_rad: float
    roll_rad: float
    heading_rad: float
    position_m: np.ndarray
    elevation_m: float
    rng: np.random.Generator
    std_px: float = 0.0
    std_share: float = 0.0

    @classmethod
    def random(cls, rng, tilt_deg=(15.0, 72.0), roll_std_deg=3.0, **known):
        """Anywhere up to 100 m above the ground, with a lens that is a little bent."""
        focal = rng.uniform(1100, 2000)
        camera = Camera(
            name="random", width_px=WIDTH_PX, height_px=HEIGHT_PX, fx_px=focal, fy_px=focal * rng.uniform(0.98, 1.02),
            cx_px=960 + rng.uniform(-30, 30), cy_px=540 + rng.uniform(-30, 30),
            distortion=tuple(rng.uniform(-1, 1, 4) * [0.1, 0.02, 1e-3, 1e-3]),
        )  # fmt: skip
        elevation = rng.uniform(-2, 2)
        position = np.array([*rng.normal(size=2) * 20, elevation + math.exp(rng.uniform(math.log(4), math.log(100)))])
        tilt, heading = math.radians(rng.uniform(*tilt_deg)), rng.uniform(0, 2 * math.pi)
        roll = math.radians(roll_std_deg) * rng.normal()
        return cls(camera, tilt, roll, heading, position, elevation, rng, **known)

    @property
    def axes(self):
        return camera_axes(self.tilt_rad, self.roll_rad, self.heading_rad)

    @property
    def above_m(self):
        return float(self.position_m[2]) - self.elevation_m

    @property
    def truth(self):
        """By the names of unknowns; SI units, pixels."""
        east, north, up = self.position_m.tolist()
        lens = self.camera
        return {
            "east": east, "north": north, "height": up, "tilt": self.tilt_rad, "roll": self.roll_rad,
            "heading": self.heading_rad, "elevation": self.elevation_m, "focal": lens.fx_px, "fx": lens.fx_px,
            "fy": lens.fy_px, "cx": lens.cx_px, "cy": lens.cy_px,
        } | dict(zip(("k1", "k2", "p1", "p2"), lens.distortion, strict=False))  # fmt: skip

    def state(self):
        return State.from_angles(
            self.camera, self.position_m, (self.tilt_rad, self.roll_rad, self.heading_rad), self.elevation_m
        )

    def exact(self, names):
        """Priors that say these values are known exactly."""
        return {name: Prior(value=self.truth[name], std=0.0) for name in names}

    def prior(self, name, std):
        """What somebody says of an unknown who knows it so well."""
        return Prior(value=self.truth[name] + std * self.rng.normal(), std=std)

    # ---- what is seen

    def pixels(self, points_m):
        """Of points ``(n, 3)``, with their errors; refused where they are not in the image."""
        points = np.asarray(points_m).reshape(-1, 3)
        if not np.all(self._is_ahead(points - self.position_m)):
            raise ImpossibleError
        exact = opencv_pixels(self.camera, self.axes, self.position_m, points)
        if not np.all((exact > INSIDE_PX) & (exact < [WIDTH_PX - INSIDE_PX, HEIGHT_PX - INSIDE_PX])):
            raise ImpossibleError
        return self._off(exact)

    def _is_ahead(self, directions_enu):
        """Within the field of view or close to it: OpenCV folds what is far outside back into the image."""
        rays = directions_enu @ self.axes
        return (rays[:, 2] > 0) & (np.hypot(rays[:, 0], rays[:, 1]) < WIDTH_PX / self.camera.fx_px * rays[:, 2])

    def _off(self, pixels):
        return tuple(map(tuple, (pixels + self.std_px * self.rng.normal(size=pixels.shape)).tolist()))

    def spot(self, above_m=0.0):
        """A random point so far above the ground, within the image."""
        for _ in range(100):
            pixel = self.rng.uniform(INSIDE_PX, [WIDTH_PX - INSIDE_PX, HEIGHT_PX - INSIDE_PX])
            ray = self.axes @ opencv_rays(self.camera, [pixel])[0]
            if depression_rad(ray) > LOWEST_RAD:
                return self.position_m + ray * (self.elevation_m + above_m - self.position_m[2]) / ray[2]
        raise ImpossibleError

    def _std_m(self, size_m):
        return self.std_share * size_m

    def landmark(self, name, unknown=None, most_above=0.2):
        """A place up to ``most_above`` of the camera's height above the ground; perhaps with an unknown component."""
        point = self.spot(self.rng.uniform(0.0, most_above) * self.above_m)
        std = self._std_m(self.above_m) * np.array([1.0, 1.0, 0.5])
        said = (point + std * self.rng.normal(size=3)).tolist()
        east, north, up = (None if axis == unknown else value for axis, value in enumerate(said))
        (pixel,) = self.pixels(point)
        return Landmark(
            name=name, pixel=pixel, position_m=(east, north, up), std_px=self.said_px, std_m=tuple(std.tolist())
        )

    @property
    def said_px(self):
        """What is stated of the pixels."""
        return self.std_px or 1.0

    def _measured(self, value):
        std = self._std_m(value)
        return {"std_m": std, "std_px": self.said_px}, value + std * self.rng.normal()

    def range_(self, name):
        point = self.spot()
        stds, found = self._measured(math.dist(point, self.position_m))
        return SlantRange(name=name, pixel=self.pixels(point)[0], range_m=found, **stds)

    def ground(self, name):
        """To the right and ahead of the foot."""
        point = self.spot()
        away = (point - self.position_m)[:2]
        sine, cosine = math.sin(self.heading_rad), math.cos(self.heading_rad)
        std = self._std_m(self.above_m)
        xy = np.array([cosine * away[0] - sine * away[1], sine * away[0] + cosine * away[1]])
        said = tuple((xy + std * self.rng.normal(size=2)).tolist())
        return GroundPoint(name=name, pixel=self.pixels(point)[0], xy_m=said, std_m=std, std_px=self.said_px)

    def length(self, name, level_share=0.1):
        """Between two points that are equally high."""
        level = self.rng.uniform(0, level_share) * self.above_m
        points = self._apart(lambda: (self.spot(level), self.spot(level)))
        stds, found = self._measured(math.dist(*points))
        return KnownLength(name=name, pixels=self.pixels(points), length_m=found, elevation_m=level, **stds)

    def height(self, name):
        """Something upright."""
        points = self._apart(lambda: self._upright(0.0), 0.4 * APART_PX)
        stds, found = self._measured(math.dist(*points))
        base, top = self.pixels(points)
        return KnownHeight(name=name, base=base, top=top, height_m=found, **stds)

    def vertical(self, name):
        """It need not stand on the ground."""
        points = self._apart(lambda: self._upright(self.rng.uniform(0, 0.3)), 0.4 * APART_PX)
        return Vertical(name=name, pixels=self.pixels(points), std_px=self.said_px)

    def _upright(self, from_share):
        foot = self.spot(from_share * self.above_m)
        return foot, foot + UP * self.rng.uniform(0.1, 0.5) * self.above_m

    def lines(self, name, *, at_right_angle):
        """Two level lines, each at its own height."""
        first = self._apart(lambda: self._line(self.rng.uniform(0, math.pi)))
        east, north, _ = first[1] - first[0]
        turned = math.atan2(east, north) + (math.pi / 2 if at_right_angle else 0.0)
        second = self._apart(lambda: self._line(turned))
        return GroundLines(
            name=name, first=self.pixels(first), second=self.pixels(second), at_right_angle=at_right_angle,
            std_px=self.said_px,
        )  # fmt: skip

    def _line(self, azimuth_rad):
        start = self.spot(self.rng.uniform(0, 0.1) * self.above_m)
        along = np.array([math.sin(azimuth_rad), math.cos(azimuth_rad), 0.0])
        return start, start + along * self.rng.uniform(-3, 3) * self.above_m

    def horizon(self, name, count=3, *, is_sea=False):
        """Level directions, or the sea's horizon; the pixels may be a little above the image."""
        dip = math.sqrt(2 * self.above_m * (1 - REFRACTION) / EARTH_RADIUS_M) if is_sea else 0.0
        azimuths = self.heading_rad + np.linspace(-0.35, 0.35, count) + self.rng.uniform(-0.05, 0.05, count)
        directions = np.column_stack([np.sin(azimuths), np.cos(azimuths), np.full(count, -math.tan(dip))])
        if not np.all(self._is_ahead(directions)):
            raise ImpossibleError
        seen = opencv_pixels(self.camera, self.axes, np.zeros(3), directions)
        return Horizon(name=name, pixels=self._off(seen), is_sea=is_sea, std_px=self.said_px)

    def _apart(self, points, least_px=APART_PX):
        """A pair that is seen far enough apart."""
        exact = replace(self, std_px=0.0)
        for _ in range(200):
            pair = points()
            try:
                seen = np.array(exact.pixels(pair))
            except ImpossibleError:
                continue
            if np.linalg.norm(seen[1] - seen[0]) > least_px and self._is_low(pair):
                return pair
        raise ImpossibleError

    def _is_low(self, points):
        return all(
            depression_rad(point - self.position_m) > LOWEST_RAD
            for point in points
            if point[2] <= self.elevation_m + 0.11 * self.above_m
        )
