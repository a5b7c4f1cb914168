"""The simulated world: ground, a river with banks and widths in closed form, surveyed landmarks."""

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from aerodft.model import FloatArray, GeoOrigin

_NEWTON_STEPS = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class Island:
    """An island: a lens of land in the river.

    Attributes:
        station_m: River station of its middle.
        length_m: From tip to tip.
        width_m: At its middle.
    """

    station_m: float
    length_m: float
    width_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class River:
    """A river with a sinusoidal centreline and a sinusoidal width.

    River axes: ``along`` (the station) in the direction of flow, ``across`` to the left of it.

    Attributes:
        origin_en_m: East and north of station 0 on the river's straight axis.
        azimuth_rad: Direction of flow, clockwise from north.
        width_m: Mean width across the axis.
        width_swing_m: Amplitude of the width.
        width_wavelength_m: Its wavelength.
        meander_m: Amplitude of the centreline.
        meander_wavelength_m: Its wavelength.
        flow_mps: Speed of the water's texture.
        islands: Islands, not overlapping; a braided river has several.
    """

    origin_en_m: tuple[float, float] = (0.0, 0.0)
    azimuth_rad: float = math.pi / 2
    width_m: float = 22.0
    width_swing_m: float = 3.0
    width_wavelength_m: float = 90.0
    meander_m: float = 3.0
    meander_wavelength_m: float = 170.0
    flow_mps: float = 0.8
    islands: tuple[Island, ...] = ()

    def __post_init__(self) -> None:
        if not self.width_m > abs(self.width_swing_m):
            raise ValueError(f"river width {self.width_m} m swings by {self.width_swing_m} m, it must stay above 0")

    def centre_m(self, along_m: npt.ArrayLike) -> FloatArray:
        """Across coordinates ``(...)`` of the centreline."""
        return self.meander_m * np.sin(2 * np.pi * np.asarray(along_m) / self.meander_wavelength_m)

    def banks_m(self, along_m: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Across coordinates ``(...)`` of the left and of the right bank."""
        along = np.asarray(along_m, dtype=np.float64)
        half = 0.5 * (self.width_m + self.width_swing_m * np.sin(2 * np.pi * along / self.width_wavelength_m))
        centre = self.centre_m(along)
        return centre + half, centre - half

    def shores_m(self, along_m: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Across coordinates ``(...)`` of the islands' left and right shores; NaN where there is no island."""
        along = np.asarray(along_m, dtype=np.float64)
        half = np.full(along.shape, np.nan)
        for island in self.islands:
            phase = (along - island.station_m) / island.length_m
            half = np.where(np.abs(phase) < 0.5, 0.5 * island.width_m * np.cos(np.pi * phase) ** 2, half)  # noqa: PLR2004
        centre = self.centre_m(along)
        return centre + half, centre - half

    def enu(self, along_m: npt.ArrayLike, across_m: npt.ArrayLike) -> FloatArray:
        """ENU points ``(..., 3)`` on the plane from river coordinates."""
        along, across = np.broadcast_arrays(np.asarray(along_m, dtype=np.float64), np.asarray(across_m))
        sine, cosine = math.sin(self.azimuth_rad), math.cos(self.azimuth_rad)
        east = self.origin_en_m[0] + along * sine - across * cosine
        north = self.origin_en_m[1] + along * cosine + across * sine
        return np.stack([east, north, np.zeros_like(east)], axis=-1)

    def along_across(self, points_enu_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """River coordinates, each ``(...)``, from ENU points ``(..., 2 or 3)``."""
        east, north = points_enu_m[..., 0] - self.origin_en_m[0], points_enu_m[..., 1] - self.origin_en_m[1]
        sine, cosine = math.sin(self.azimuth_rad), math.cos(self.azimuth_rad)
        return east * sine + north * cosine, north * sine - east * cosine

    def crossing(self, stations_m: npt.ArrayLike) -> FloatArray:
        """Left and right bank points on the normal to the centreline at ``stations_m (...)``, ENU ``(..., 2, 3)``."""
        return np.stack([self._curve_crossing(stations_m, side, island=False) for side in (0, 1)], axis=-2)

    def island_crossing(self, stations_m: npt.ArrayLike) -> FloatArray:
        """Island shore points on the normals to the centreline, as ``crossing``; NaN without an island."""
        return np.stack([self._curve_crossing(stations_m, side, island=True) for side in (0, 1)], axis=-2)

    def width_at(self, stations_m: npt.ArrayLike) -> FloatArray:
        """Width ``(...)`` from bank to bank along the normal to the centreline, islands included."""
        points = self.crossing(stations_m)
        return np.asarray(np.linalg.norm(points[..., 0, :] - points[..., 1, :], axis=-1))

    def _curve_crossing(self, stations_m: npt.ArrayLike, side: int, *, island: bool) -> FloatArray:
        station = np.asarray(stations_m, dtype=np.float64)
        curve = self.shores_m if island else self.banks_m
        rate = 2 * np.pi / self.meander_wavelength_m
        slope = self.meander_m * rate * np.cos(rate * station)
        centre = self.centre_m(station)
        # Points of the normal are (station - slope * t, centre + t); Newton for where the curve passes through it.
        t = curve(station)[side] - centre
        for _ in range(_NEWTON_STEPS):
            along, step = station - slope * t, 1e-4
            error = centre + t - curve(along)[side]
            derivative = 1 + slope * (curve(along + step)[side] - curve(along - step)[side]) / (2 * step)
            t = t - error / derivative
        return self.enu(station - slope * t, centre + t)


@dataclass(frozen=True, slots=True, kw_only=True)
class Marker:
    """An ArUco marker (4x4, 50 words) flat on the ground.

    Attributes:
        id: Its number in the dictionary.
        east_m: Its centre.
        north_m: Its centre.
        side_m: Side of the black square; a white margin surrounds it.
        heading_rad: Direction of the marker's top, clockwise from north.
    """

    id: int
    east_m: float
    north_m: float
    side_m: float = 1.5
    heading_rad: float = 0.0

    def corners_enu_m(self, scale: float = 1.0) -> FloatArray:
        """Corners ``(4, 3)``: top-left, top-right, bottom-right, bottom-left as the marker is read."""
        half = 0.5 * self.side_m * scale
        right = np.array([math.cos(self.heading_rad), -math.sin(self.heading_rad), 0.0])
        top = np.array([math.sin(self.heading_rad), math.cos(self.heading_rad), 0.0])
        signs = ((-1, 1), (1, 1), (1, -1), (-1, -1))
        return self.centre_enu_m + half * np.array([x * right + y * top for x, y in signs])

    @property
    def centre_enu_m(self) -> FloatArray:
        """The centre ``(3,)``."""
        return np.array([self.east_m, self.north_m, 0.0])


@dataclass(frozen=True, slots=True, kw_only=True)
class Post:
    """A vertical post of known height, equally wide from all sides."""

    name: str
    east_m: float
    north_m: float
    height_m: float = 3.0
    width_m: float = 0.25

    def ends_enu_m(self) -> FloatArray:
        """Base and top of the axis, ``(2, 3)``."""
        return np.array([[self.east_m, self.north_m, 0.0], [self.east_m, self.north_m, self.height_m]])


@dataclass(frozen=True, slots=True, kw_only=True)
class Walker:
    """A person-sized object that walks to and fro between two points, seen from ``from_s`` after the start on."""

    start_en_m: tuple[float, float]
    end_en_m: tuple[float, float]
    speed_mps: float = 1.4
    height_m: float = 1.75
    width_m: float = 0.55
    shadow: bool = True
    from_s: float = 0.0

    def foot_enu_m(self, time_s: float) -> FloatArray:
        """Position ``(3,)`` of the feet at ``time_s`` of the flight."""
        start, end = np.array(self.start_en_m), np.array(self.end_en_m)
        length = float(np.linalg.norm(end - start))
        if length == 0:
            return np.array([*start, 0.0])
        phase = (time_s * self.speed_mps / length) % 2
        east, north = start + (end - start) * min(phase, 2 - phase)
        return np.array([east, north, 0.0])


@dataclass(frozen=True, slots=True, kw_only=True)
class Wall:
    """An upright wall between two points; it occludes, but casts no shadow."""

    start_en_m: tuple[float, float]
    end_en_m: tuple[float, float]
    height_m: float = 2.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Appearance:
    """Appearance of the world, without effect on geometry.

    Attributes:
        ground_contrast: Of the ground's texture; 0 for one flat colour.
        water_contrast: Of the water's texture; 0 for one flat colour.
        sun_azimuth_rad: Where the sun stands, clockwise from north.
        sun_elevation_rad: Above the horizon.
    """

    ground_contrast: float = 1.0
    water_contrast: float = 1.0
    sun_azimuth_rad: float = math.radians(135.0)
    sun_elevation_rad: float = math.radians(45.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """All objects of the world; the plane is at up = 0.

    Attributes:
        origin: The ENU origin, a point of the plane.
        river: The river.
        markers: Surveyed markers.
        posts: Posts of known height.
        walkers: Moving persons.
        walls: Walls that occlude walkers.
        seed: Of the textures.
        look: Contrast and sun.
    """

    origin: GeoOrigin
    river: River = field(default_factory=River)
    markers: tuple[Marker, ...] = ()
    posts: tuple[Post, ...] = ()
    walkers: tuple[Walker, ...] = ()
    walls: tuple[Wall, ...] = ()
    seed: int = 1
    look: Appearance = field(default_factory=Appearance)

    def landmarks_enu_m(self) -> dict[str, FloatArray]:
        """Surveyed points ``(3,)`` by name: ``marker-7`` (its centre), ``post-1`` (its base)."""
        named = {f"marker-{marker.id}": marker.centre_enu_m for marker in self.markers}
        return named | {post.name: post.ends_enu_m()[0] for post in self.posts}


DEFAULT_ORIGIN = GeoOrigin(lat_rad=math.radians(-35.363262), lon_rad=math.radians(149.165237), alt_msl_m=584.0)
"""ENU origin of generated flights."""


def furnished_world(
    river: River, *, origin: GeoOrigin = DEFAULT_ORIGIN, seed: int = 1, look: Appearance | None = None
) -> World:
    """A world with markers and posts along both banks of ``river``, and a walker beside it.

    Markers and posts stand 3 to 6 m from the water, between stations -60 m and 100 m.
    """
    markers, posts = [], []
    for index, station in enumerate(np.arange(-60.0, 101.0, 20.0)):
        left, right = river.banks_m(station)
        across = float(left) + 4.0 if index % 2 else float(right) - 4.0
        east, north, _ = river.enu(station, across)
        markers.append(Marker(id=index, east_m=east, north_m=north, heading_rad=0.4 * index))
        across = float(right) - 3.0 if index % 2 else float(left) + 3.0
        east, north, _ = river.enu(station + 6.0, across)
        posts.append(Post(name=f"post-{index}", east_m=east, north_m=north, height_m=2.0 + 0.5 * (index % 3)))
    path = river.enu([0.0, 30.0], [float(river.banks_m(along)[0]) + 6.0 for along in (0.0, 30.0)])
    walker = Walker(start_en_m=(path[0, 0], path[0, 1]), end_en_m=(path[1, 0], path[1, 1]))
    return World(
        origin=origin,
        river=river,
        markers=tuple(markers),
        posts=tuple(posts),
        walkers=(walker,),
        seed=seed,
        look=look or Appearance(),
    )
