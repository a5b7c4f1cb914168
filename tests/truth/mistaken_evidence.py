"""Scenes with landmarks, by OpenCV alone, and the mistakes that people make when they write them down."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import tomli_w
from pyproj import Transformer

from .scenes import camera_axes

FOOT_M = 0.3048
UTM = "EPSG:32633"
UTM_ZERO_M = np.array([592_850.0, 6_582_050.0, 62.0])
TO_GEO = Transformer.from_pipeline(
    "+proj=pipeline +step +inv +proj=tmerc +lat_0=47.3 +lon_0=11.4 +ellps=WGS84 +step +proj=unitconvert"
    " +xy_in=rad +xy_out=deg"
)
INSIDE = 0.03
"""Share of the image's width and height along its border where no landmark is taken."""
LENSES = {
    "straight": ("brown", (0.0, 0.0, 0.0, 0.0)),
    "drone": ("brown", (-0.02, 0.01, 0.0004, -0.0003)),
    "barrel": ("brown", (-0.35, 0.12, 0.0, 0.0, 0.0)),
    "folding": ("brown", (-0.3, 0.03, 0.001, 0.0, 0.0)),
    "fisheye": ("fisheye", (0.02, -0.01, 0.003, -0.001)),
}
SIZES = ((1920, 1080), (4000, 3000), (4290, 2856), (1280, 720), (5472, 3648))


@dataclass(frozen=True)
class Lens:
    """A lens as its file has it."""

    width_px: int
    height_px: int
    focal_px: float
    model: str = "brown"
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)

    @property
    def centre_px(self):
        return np.array([self.width_px - 1, self.height_px - 1]) / 2

    def pixels(self, rays_cam):
        """Of rays ``(n, 3)``, by OpenCV; NaN behind the camera and beyond 1.2 times the half diagonal."""
        matrix = np.array([[self.focal_px, 0, self.centre_px[0]], [0, self.focal_px, self.centre_px[1]], [0, 0, 1.0]])
        project = cv2.fisheye.projectPoints if self.model == "fisheye" else cv2.projectPoints
        points = np.ascontiguousarray(rays_cam, dtype=float).reshape(-1, 1, 3)
        seen = project(points, np.zeros(3), np.zeros(3), matrix, np.array(self.distortion))[0].reshape(-1, 2)
        angle = np.arctan2(np.hypot(rays_cam[:, 0], rays_cam[:, 1]), rays_cam[:, 2])
        diagonal = math.hypot(self.width_px, self.height_px) / 2
        widest = diagonal / self.focal_px if self.model == "fisheye" else math.atan(1.5 * diagonal / self.focal_px)
        return np.where((angle < min(1.2 * widest, 1.4))[:, None], seen, np.nan)

    def table(self):
        cx, cy = self.centre_px.tolist()
        return {
            "name": "mistaken", "width_px": self.width_px, "height_px": self.height_px, "fx_px": self.focal_px,
            "fy_px": self.focal_px, "cx_px": cx, "cy_px": cy, "lens": self.model, "distortion": list(self.distortion),
        }  # fmt: skip


@dataclass(frozen=True)
class Evidence:
    """What somebody writes down.

    Attributes:
        crs: Of the places.
        pixels: ``(n, 2)``.
        places: ``(n, 3)`` in the crs.
        std_px: Of the pixels.
        std_m: Of the places.
        camera: Values of ``[camera]``.
        lens: As its file has it.
    """

    crs: str
    pixels: np.ndarray
    places: np.ndarray
    std_px: float
    std_m: float
    camera: dict
    lens: Lens

    def write(self, folder: Path):
        """The file of evidence and the camera file."""
        keys = ("lat_deg", "lon_deg", "alt_m")
        rows = [
            {"name": f"g{index}", "pixel": pixel, "std_px": self.std_px}
            | ({"std_m": self.std_m} if self.std_m else {})
            | (dict(zip(keys, place, strict=True)) if self.crs == "geo" else {"position_m": place})
            for index, (pixel, place) in enumerate(zip(self.pixels.tolist(), self.places.tolist(), strict=True))
        ]
        table = {"crs": self.crs, "landmark": rows} | ({"camera": self.camera} if self.camera else {})
        evidence, lens = folder / "evidence.toml", folder / "camera.toml"
        evidence.write_text(tomli_w.dumps(table))
        lens.write_text(tomli_w.dumps(self.lens.table()))
        return evidence, lens


@dataclass(frozen=True)
class Scene:
    """A camera, its landmarks and what is right of them.

    Attributes:
        truth: What ``calibrate`` finds, by its names; east and north where the crs is in metres.
        evidence: Without a mistake.
        eye_m: Camera in the frame of ``places_m``.
        places_m: ``(n, 3)`` true places, metres.
    """

    truth: dict
    evidence: Evidence
    eye_m: np.ndarray
    places_m: np.ndarray


def drawn_scene(seed):
    """A scene that somebody may have: tilts of 2 to 80 deg, 4 to 150 m high, 6 to 12 landmarks."""
    rng = np.random.default_rng([7, seed])
    lens = _drawn_lens(rng, SIZES[seed % len(SIZES)])
    tilt = float(np.linspace(2, 80, 20)[seed % 20])
    above, heading, roll = math.exp(rng.uniform(math.log(4), math.log(150))), rng.uniform(0, 360), rng.normal(0, 2)
    axes = camera_axes(*map(math.radians, (tilt, roll, heading)))
    eye = np.array([rng.normal(0, 5), rng.normal(0, 5), above])
    relief = (0.0, 0.05, 0.3)[int(rng.integers(3))] * above
    count, std_px = int(rng.integers(6, 13)), (1.0, 3.0)[int(rng.integers(2))]
    places = _drawn_places(rng, lens, (axes, eye, tilt, heading), relief, count)
    pixels = lens.pixels((places - eye) @ axes) + rng.normal(0, std_px, (count, 2))
    std_m = (0.0, 0.003 * above)[int(rng.integers(2))]
    said = places + rng.normal(0, 1, places.shape) * std_m
    crs = ("local", UTM, "geo", "local")[seed % 4]
    plane = 0.0 if crs == "local" else float(np.median(said[:, 2]))
    truth = {"height_agl_m": above - plane, "tilt_deg": tilt, "roll_deg": roll, "heading_deg": heading}
    zero = {"local": np.zeros(3), UTM: UTM_ZERO_M, "geo": np.array([0.0, 0.0, 580.0])}[crs]
    if crs != "geo":
        truth |= {"east_m": eye[0] + zero[0], "north_m": eye[1] + zero[1]}
    said = said + zero
    if crs == "geo":
        lon, lat = TO_GEO.transform(said[:, 0], said[:, 1])
        said = np.column_stack([lat, lon, said[:, 2]])
    known = _drawn_knowledge(rng, seed, truth)
    return Scene(truth, Evidence(crs, pixels, said, std_px, std_m, known, lens), eye, places)


def _drawn_lens(rng, size):
    model, distortion = LENSES[list(LENSES)[int(rng.integers(len(LENSES)))]]
    low, high = (0.45, 0.45) if model == "fisheye" else (0.7, 0.9) if distortion[0] < -0.1 else (0.7, 2.0)
    width_px, height_px = size
    return Lens(width_px, height_px, round(width_px * rng.uniform(low, high), 1), model, distortion)


def _drawn_places(rng, lens, camera, relief, count):
    axes, eye, tilt, heading = camera
    size = np.array([lens.width_px, lens.height_px])
    ahead = np.array([math.sin(math.radians(heading)), math.cos(math.radians(heading))])
    middle = eye[:2] + ahead * eye[2] * math.tan(math.radians(min(tilt, 76)))
    places: list = []
    while len(places) < count:
        place = np.array([*(middle + rng.normal(size=2) * eye[2] * 3), rng.uniform(0, relief) if relief else 0.0])
        seen = lens.pixels(((place - eye) @ axes)[None])[0]
        is_inside = np.all(seen > INSIDE * size) and np.all(seen < (1 - INSIDE) * size)
        if is_inside and math.dist(place, eye) < 30 * eye[2]:
            places.append(place)
    return np.array(places)


def _drawn_knowledge(rng, seed, truth):
    """What is stated of the camera in some scenes: its place, or its tilt."""
    if seed % 5 == 1 and "east_m" in truth:
        place = np.array([truth["east_m"], truth["north_m"]]) + rng.normal(0, 0.3, 2)
        height = {"value": truth["height_agl_m"] + rng.normal(0, 0.1), "std": 0.1}
        return {"position_m": {"value": place.tolist(), "std": 0.3}, "height_agl_m": height}
    if seed % 5 == 2:
        return {"tilt_deg": {"value": min(max(truth["tilt_deg"] + rng.normal(0, 3), 0), 90), "std": 3.0}}
    return {}


def _pixels(e, pixels):
    return replace(e, pixels=np.asarray(pixels, dtype=float))


def _places(e, places):
    return replace(e, places=np.asarray(places, dtype=float))


def _one_place(e, rng, by_m):
    index, azimuth = int(rng.integers(len(e.places))), rng.uniform(0, 2 * math.pi)
    places, shift = e.places.copy(), by_m * np.array([math.sin(azimuth), math.cos(azimuth)])
    if e.crs == "geo":
        shift = np.array([shift[1] / 111_200, shift[0] / 75_500])
    places[index, :2] += shift
    return _places(e, places)


def _digit(e, rng, column):
    index = int(rng.integers(len(e.places)))
    values = e.places.copy() if column >= 2 else e.pixels.copy()
    at = column - 2 if column >= 2 else column
    text = f"{values[index, at]:.5f}" if e.crs == "geo" and column >= 2 else f"{values[index, at]:.2f}"
    digits = [k for k in range(text.index(".")) if text[k].isdigit()]
    gone = digits[int(rng.integers(len(digits)))]
    short = text[:gone] + text[gone + 1 :]
    values[index, at] = float(short if short[0] != "." and short[:2] != "-." else "0")
    return _places(e, values) if column >= 2 else _pixels(e, values)


def _other_lens(e, rng):
    focal = e.lens.focal_px * float(rng.choice([0.5, 0.7, 1.5, 2.0]))
    return replace(e, lens=replace(e.lens, focal_px=focal))


def _bent(e, _):
    other = (-0.3, 0.1, 0.0, 0.0) if e.lens.distortion[0] > -0.1 else (0.0, 0.0, 0.0, 0.0)
    return replace(e, lens=replace(e.lens, model="brown", distortion=other))


def _smaller_lens(e, _):
    """Somebody halves the image and keeps the pixels of the half."""
    return _pixels(e, (e.pixels + 0.5) / 2 - 0.5)


MISTAKES: dict[str, Callable] = {
    "none": lambda e, _: e,
    "flat": lambda e, _: _places(e, np.column_stack([e.places[:, :2], np.full(len(e.places), e.places[0, 2])])),
    "feet": lambda e, _: _places(e, e.places / [1, 1, FOOT_M]),
    "depths": lambda e, _: _places(e, e.places * [1, 1, -1]),
    "focal": _other_lens,
    "bent": _bent,
    "shuffled": lambda e, rng: _pixels(e, e.pixels[rng.permutation(len(e.pixels))]),
    "two swapped": lambda e, _: _pixels(e, e.pixels[[1, 0, *range(2, len(e.pixels))]]),
    "rows": lambda e, _: _pixels(e, np.roll(e.pixels, 1, axis=0)),
    "half": _smaller_lens,
    "mirrored": lambda e, _: _pixels(e, np.column_stack([e.lens.width_px - 1 - e.pixels[:, 0], e.pixels[:, 1]])),
    "v up": lambda e, _: _pixels(e, np.column_stack([e.pixels[:, 0], e.lens.height_px - 1 - e.pixels[:, 1]])),
    "uv": lambda e, _: _pixels(e, e.pixels[:, ::-1]),
    "xy": lambda e, _: _places(e, e.places[:, [1, 0, 2]]),
    "1 m": lambda e, rng: _one_place(e, rng, 1.0),
    "10 m": lambda e, rng: _one_place(e, rng, 10.0),
    "100 m": lambda e, rng: _one_place(e, rng, 100.0),
    "digit u": lambda e, rng: _digit(e, rng, 0),
    "digit v": lambda e, rng: _digit(e, rng, 1),
    "digit x": lambda e, rng: _digit(e, rng, 2),
    "digit y": lambda e, rng: _digit(e, rng, 3),
    "digit z": lambda e, rng: _digit(e, rng, 4),
}
