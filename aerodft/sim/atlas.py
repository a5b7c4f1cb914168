"""The world as GeoJSON: banks, islands, landmarks, with their true ENU coordinates as properties."""

import math
from typing import Any

import numpy as np

from aerodft.geometry.geodesy import lat_lon
from aerodft.model.arrays import FloatArray
from aerodft.sim.world import World

_REACH_M = 400.0
_STEP_M = 2.0


def world_document(world: World) -> dict[str, Any]:
    """A FeatureCollection; its member ``origin`` is the ENU origin."""
    along = np.arange(-_REACH_M, _REACH_M + _STEP_M, _STEP_M)
    features = [
        _line(world, name, world.river.enu(along, across))
        for name, across in zip(("bank-left", "bank-right"), world.river.banks_m(along), strict=True)
    ]
    for index, island in enumerate(world.river.islands):
        stations = island.station_m + island.length_m * np.linspace(-0.499, 0.499, 41)
        left, right = (world.river.enu(stations, across) for across in world.river.shores_m(stations))
        features.append(_line(world, f"island-{index}", np.concatenate([left, right[::-1], left[:1]])))
    for marker in world.markers:
        properties = {"side_m": marker.side_m, "corners_enu_m": marker.corners_enu_m().tolist()}
        features.append(_point(world, f"marker-{marker.id}", marker.centre_enu_m, properties))
    features += [_point(world, post.name, post.ends_enu_m()[0], {"height_m": post.height_m}) for post in world.posts]
    origin = world.origin
    return {
        "type": "FeatureCollection",
        "origin": {
            "lat_deg": math.degrees(origin.lat_rad),
            "lon_deg": math.degrees(origin.lon_rad),
            "alt_msl_m": origin.alt_msl_m,
        },
        "features": features,
    }


def _coordinates(world: World, points_enu_m: FloatArray) -> list[list[float]]:
    """Longitude and latitude (deg) of ``(n, 3)``."""
    found: list[list[float]] = np.degrees(lat_lon(world.origin, points_enu_m[:, :2]))[:, ::-1].tolist()
    return found


def _line(world: World, name: str, points_enu_m: FloatArray) -> dict[str, Any]:
    geometry = {"type": "LineString", "coordinates": _coordinates(world, points_enu_m)}
    return {
        "type": "Feature",
        "geometry": geometry,
        "properties": {"name": name, "enu_m": points_enu_m.tolist()},
    }


def _point(world: World, name: str, point_enu_m: FloatArray, properties: dict[str, Any]) -> dict[str, Any]:
    geometry = {"type": "Point", "coordinates": _coordinates(world, point_enu_m[None])[0]}
    return {
        "type": "Feature",
        "geometry": geometry,
        "properties": {"name": name, "enu_m": point_enu_m.tolist(), **properties},
    }
