"""The simulated place: ground, river, surveyed landmarks, all known in ENU on a flat plane."""

import math
from dataclasses import dataclass, field

import numpy as np

from aerodft.model import FloatArray, GeoOrigin
from aerodft.sim.river import River


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
        """Corners top-left, top-right, bottom-right, bottom-left as the marker is read, ``(4, 3)``."""
        half = 0.5 * self.side_m * scale
        right = np.array([math.cos(self.heading_rad), -math.sin(self.heading_rad), 0.0])
        top = np.array([math.sin(self.heading_rad), math.cos(self.heading_rad), 0.0])
        signs = ((-1, 1), (1, 1), (1, -1), (-1, -1))
        return self.centre_enu_m + half * np.array([x * right + y * top for x, y in signs])

    @property
    def centre_enu_m(self) -> FloatArray:
        """``(3,)``."""
        return np.array([self.east_m, self.north_m, 0.0])


@dataclass(frozen=True, slots=True, kw_only=True)
class Post:
    """A vertical post of known height, seen equally wide from everywhere."""

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
    """A person-sized object that walks to and fro between two points."""

    start_en_m: tuple[float, float]
    end_en_m: tuple[float, float]
    speed_mps: float = 1.4
    height_m: float = 1.75
    width_m: float = 0.55
    shadow: bool = True

    def foot_enu_m(self, time_s: float) -> FloatArray:
        """Where the feet are at ``time_s`` of the flight, ``(3,)``."""
        start, end = np.array(self.start_en_m), np.array(self.end_en_m)
        length = float(np.linalg.norm(end - start))
        if length == 0:
            return np.array([*start, 0.0])
        turn = (time_s * self.speed_mps / length) % 2
        east, north = start + (end - start) * min(turn, 2 - turn)
        return np.array([east, north, 0.0])


@dataclass(frozen=True, slots=True, kw_only=True)
class Wall:
    """An upright wall between two points, which hides what is behind it and casts no shadow."""

    start_en_m: tuple[float, float]
    end_en_m: tuple[float, float]
    height_m: float = 2.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """What does not change where things are.

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
    """Everything that stands, lies, flows or walks; the plane is at up = 0.

    Attributes:
        origin: The ENU origin, a point of the plane.
        river: The river.
        markers: Surveyed markers.
        posts: Posts of known height.
        walkers: Moving persons.
        walls: What they may walk behind.
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
    look: Look = field(default_factory=Look)

    def landmarks_enu_m(self) -> dict[str, FloatArray]:
        """The surveyed points by name, each ``(3,)``: ``marker-7`` (its centre), ``post-1`` (its base)."""
        named = {f"marker-{marker.id}": marker.centre_enu_m for marker in self.markers}
        return named | {post.name: post.ends_enu_m()[0] for post in self.posts}


DEFAULT_ORIGIN = GeoOrigin(lat_rad=math.radians(-35.363262), lon_rad=math.radians(149.165237), alt_msl_m=584.0)
"""Where generated flights start."""


def furnished(river: River, *, origin: GeoOrigin = DEFAULT_ORIGIN, seed: int = 1, look: Look | None = None) -> World:
    """A world with markers and posts along both banks of ``river``, and somebody walking beside it.

    They stand 3 to 6 m from the water, between stations -60 m and 100 m.
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
        look=look or Look(),
    )
