"""Which photographs of a folder are of one flight: copies, photographs of another place and those without one."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from aerodft.adapters.files import read_whole
from aerodft.adapters.photographs.dialect import PhotoPose
from aerodft.adapters.photographs.tags import PhotoTags
from aerodft.errors import InputError, os_errors_as
from aerodft.model import FloatArray, IntArray

_APART_M: Final = 1000.0  # chosen: photographs of one flight follow each other within 100 m, flights begin within 500 m
_EARTH_RADIUS_M: Final = 6_371_000.0
_MAJORITY: Final = 0.5
_MOST_NAMED: Final = 5


@dataclass(frozen=True, slots=True)
class Photo:
    """A photograph of a folder: its file, what it says, and its pose by that."""

    path: Path
    tags: PhotoTags
    pose: PhotoPose


def of_one_flight(photos: Sequence[Photo], folder: Path) -> tuple[list[Photo], list[str]]:
    """The photographs of a folder that are of one flight, and sentences on the others and why they are left out.

    Args:
        photos: All that carry a pose, in order.
        folder: For the sentence that refuses.

    Raises:
        InputError: They are of several places, and most are of none of them; or a file cannot be read.
    """
    kept, sentences = _without_copies(photos)
    placed = [each for each in kept if each.pose.lat_rad is not None]
    if placed and len(placed) < len(kept):
        names = _names([each for each in kept if each.pose.lat_rad is None])
        sentences.append(f"{len(kept) - len(placed)} of {len(kept)} photographs state no position: left out ({names})")
        kept = placed
    if not placed:
        return kept, sentences
    points_m, labels = _clusters(placed)
    counts = np.bincount(labels)
    main = int(np.argmax(counts))
    if counts[main] <= _MAJORITY * len(placed):
        got = ", ".join(f"{count} photographs at {_where(placed, labels == k)}" for k, count in enumerate(counts))
        hint = "put each place's photographs into a folder"
        raise InputError("photographs of several places", where=folder, got=got, hint=hint)
    if len(counts) > 1:
        others = [each for each, label in zip(placed, labels.tolist(), strict=True) if label != main]
        tree = cKDTree(points_m[labels == main])
        least_km = float(np.min(tree.query(points_m[labels != main])[0])) / 1000
        sentences.append(
            f"{len(others)} of {len(kept)} photographs are of another place, {least_km:.1f} km and more from the rest: "
            f"left out ({_names(others)})"
        )
    return [each for each, label in zip(placed, labels.tolist(), strict=True) if label == main], sentences


def _without_copies(photos: Sequence[Photo]) -> tuple[list[Photo], list[str]]:
    """Photographs without copies of a file; and sentences on these, and on those that say the same as another one."""
    by_statement: dict[object, list[Photo]] = {}
    for each in photos:
        by_statement.setdefault(_statement(each), []).append(each)
    copies, alike = list[Photo](), list[Photo]()
    for statement, group in by_statement.items():
        if statement is None or len(group) == 1:
            continue
        seen = set[bytes]()
        for each in sorted(group, key=lambda photo: (len(photo.path.name), photo.path.name)):
            with os_errors_as("cannot be read", where=each.path):
                digest = hashlib.sha256(read_whole(each.path)).digest()
            (copies if digest in seen else alike if seen else []).append(each)
            seen.add(digest)
    sentences = []
    if copies:
        sentences.append(
            f"{len(copies)} of {len(photos)} photographs are copies of others: left out ({_names(copies)})"
        )
    if alike:
        sentences.append(
            f"{len(alike)} of {len(photos)} photographs state time and pose of another one: are they edited copies, "
            f"or a burst? ({_names(alike)})"
        )
    left_out = {each.path for each in copies}
    return [each for each in photos if each.path not in left_out], sentences


def _statement(photo: Photo) -> object:
    """What tells photographs apart that are not copies: time, place, attitude and exposure; None without a time."""
    exif, pose = photo.tags.exif, photo.pose
    date = exif.get("DateTimeOriginal") or photo.tags.xmp.get("xmp:CreateDate")
    if not date:
        return None
    wxyz = None if pose.wxyz is None else tuple(pose.wxyz.tolist())
    shot = tuple(str(exif.get(name)) for name in ("SubsecTimeOriginal", "ExposureTime", "FNumber", "ISOSpeedRatings"))
    return date, shot, wxyz, pose.lat_rad, pose.lon_rad, pose.height_home_m, pose.altitude_m


def _clusters(photos: Sequence[Photo]) -> tuple[FloatArray, IntArray]:
    """Places ``(n, 3)`` (m, from the earth's centre), and which group of near ones each is of ``(n,)``."""
    lat, lon = (np.array([getattr(each.pose, name) or 0.0 for each in photos]) for name in ("lat_rad", "lon_rad"))
    points_m = _EARTH_RADIUS_M * np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
    pairs = cKDTree(points_m).query_pairs(_APART_M, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(photos), len(photos)))
    return points_m, connected_components(links, directed=False)[1].astype(np.int64)


def _where(photos: Sequence[Photo], mask: np.ndarray) -> str:
    pose = photos[int(np.argmax(mask))].pose
    return f"{math.degrees(pose.lat_rad or 0.0):.4f}, {math.degrees(pose.lon_rad or 0.0):.4f}"


def _names(photos: Sequence[Photo]) -> str:
    more = ", ..." if len(photos) > _MOST_NAMED else ""
    return ", ".join(each.path.name for each in photos[:_MOST_NAMED]) + more
