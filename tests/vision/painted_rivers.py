"""Rivers that another painter than the simulator made: fractal noise for land and water, bushes, shade, foam, glare.

The camera is at the origin's zenith, looks north and has no distortion. Banks are known as a distance from them.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np

from aerodft.geometry import camera_pose
from aerodft.model import Camera

WIDTH, HEIGHT = 960, 540
FOCAL_PX = WIDTH / 2 / math.tan(math.radians(35.0))
CAMERA = Camera(
    name="painted", width_px=WIDTH, height_px=HEIGHT, fx_px=FOCAL_PX, fy_px=FOCAL_PX, cx_px=(WIDTH - 1) / 2,
    cy_px=(HEIGHT - 1) / 2,
)  # fmt: skip
TEXTURE_PX = 1024
WATERS = {"blue": (130, 95, 60), "brown": (80, 110, 130), "teal": (120, 120, 70), "sky": (205, 180, 160)}
LANDS = {
    "grass": ((50, 120, 85), (60, 140, 120)),
    "soil": ((80, 110, 140), (110, 140, 165)),
    "sand": ((150, 185, 205), (130, 165, 190)),
    "rock": ((120, 125, 130), (95, 105, 110)),
}


def fractal(seed):
    """Noise ``(n, n)`` of many sizes that repeats, mean 0 and standard deviation 1."""
    random, total = np.random.default_rng(seed), np.zeros((TEXTURE_PX, TEXTURE_PX), dtype=np.float32)
    for octave in range(7):
        cells = random.standard_normal((TEXTURE_PX >> octave, TEXTURE_PX >> octave)).astype(np.float32)
        grown = cv2.resize(np.tile(cells, (2, 2)), (2 * TEXTURE_PX, 2 * TEXTURE_PX), interpolation=cv2.INTER_CUBIC)
        middle = slice(TEXTURE_PX // 2, TEXTURE_PX // 2 + TEXTURE_PX)
        total += grown[middle, middle] * 0.8 ** (6 - octave)
    return (total - total.mean()) / total.std()


@dataclass(frozen=True)
class PaintedRiver:
    """A river ``width_m`` wide that winds by ``bend_m``, and how all of it looks."""

    seed: int
    water: str
    land: str
    tilt_deg: float
    height_m: float = 40.0
    width_m: float = 16.0
    bend_m: float = 0.0
    look: dict = field(default_factory=dict)

    @cached_property
    def noise(self):
        return [fractal(10 * self.seed + each) for each in range(4)]

    @property
    def pose(self):
        return camera_pose(height_agl_m=self.height_m, tilt_rad=math.radians(self.tilt_deg))

    @property
    def ahead_m(self):
        """Where the camera looks at, north of it."""
        return self.height_m * math.tan(math.radians(self.tilt_deg))

    def beyond_bank_m(self, east_m, north_m):
        """How far beyond a bank a place is along east; below 0 in the water."""
        turn = math.radians(15.0)
        north_m = north_m - self.ahead_m
        along, across = (
            north_m * math.cos(turn) + east_m * math.sin(turn),
            east_m * math.cos(turn) - north_m * math.sin(turn),
        )
        phase = along / (8 * self.width_m) * 2 * math.pi + self.seed
        slope = self.bend_m / (8 * self.width_m) * 2 * math.pi * np.cos(phase)
        return np.abs(across - self.bend_m * np.sin(phase)) - self.width_m / 2 * np.sqrt(1 + slope**2), along, across

    def picture(self):
        """``(height, width, 3)`` BGR."""
        u, v = np.meshgrid(np.arange(0, WIDTH, 0.5) - 0.25, np.arange(0, HEIGHT, 0.5) - 0.25)
        x, y, tilt = (u - CAMERA.cx_px) / FOCAL_PX, (v - CAMERA.cy_px) / FOCAL_PX, math.radians(self.tilt_deg)
        down = y * math.sin(tilt) + math.cos(tilt)
        away = self.height_m / np.maximum(down, 0.02)
        east, north = x * away, (math.sin(tilt) - y * math.cos(tilt)) * away
        beyond, along, across = self.beyond_bank_m(east, north)
        land, water = self._surfaces(east, north, along, across)
        fine, ground = self._sampled(0, east, north, 1.0), 0.7 * np.array(LANDS.get(self.land, ((0, 0, 0),))[0])
        if self.look.get("dim"):
            water *= 1 - 0.4 * np.exp(np.minimum(beyond, 0) / (self.look["dim"] * self.width_m))[..., None]
        if self.look.get("foam"):
            water = np.where((fine > 1.9)[..., None], 0.4 * water + 0.6 * 203.0, water)
        if self.look.get("glare"):
            spot = np.exp(-(((u / WIDTH - 0.55) / 0.09) ** 2) - ((v / HEIGHT - 0.5) / 0.15) ** 2)
            waves = self._sampled(3, along / 2, across, 0.5)
            water += 200.0 * (spot * np.clip(0.6 + 0.6 * waves, 0, 1.5))[..., None]
        if self.look.get("mirror"):
            water += self._mirrored(beyond, across, fine)[..., None] * (ground - water)
        if self.look.get("path"):
            path = (beyond > 0) & (beyond < self.look["path"] * self.width_m) & (across > 0)
            land = np.where(path[..., None], ground, land)
        image = np.where((beyond < 0)[..., None], water, land)
        if self.look.get("shade"):
            image = np.where((self._sampled(3, east, north, 2.0) > 1.1)[..., None], 0.55 * image, image)
        image[down < 0.02] = (230, 200, 170)
        image = cv2.resize(np.clip(image, 0, 255).astype(np.float32), (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
        image = cv2.GaussianBlur(image, (0, 0), 0.6) + np.random.default_rng(self.seed).normal(0, 2, image.shape)
        return np.clip(np.rint(image), 0, 255).astype(np.uint8)

    def _surfaces(self, east_m, north_m, along_m, across_m):
        """Land and water without shade or light, each ``(n, m, 3)``."""
        fine, detail, slow = (self._sampled(i, east_m, north_m, share) for i, share in ((0, 1.0), (1, 0.3), (2, 4.0)))
        mixed = np.clip(0.5 + slow, 0, 1)[..., None]
        first, second = (np.array(each, dtype=float) for each in LANDS[self.land])
        land = (first * (1 - mixed) + second * mixed) * (1 + 0.15 * fine + 0.15 * detail)[..., None]
        land += 4.0 * np.stack([detail, fine, -detail], axis=-1)
        if self.look.get("bushes"):
            land = np.where((fine > 1.0)[..., None], np.array([28.0, 62.0, 40.0]) * (1 + 0.3 * detail)[..., None], land)
        waves = self._sampled(3, along_m / 2, across_m, 0.5)
        return land, np.array(WATERS[self.water], dtype=float) * (1 + 0.08 * waves + 0.03 * slow)[..., None]

    def _mirrored(self, beyond_m, across_m, fine):
        """How much of the eastern bank the water shows, without its waves, 0 to 1: it fades into the open water."""
        strip_m = self.look["mirror"] * self.width_m
        ends_m = strip_m * (1.0 + 0.1 * fine) + beyond_m
        return np.where(across_m > 0, np.clip(0.5 + ends_m / strip_m, 0, 1), 0.0)

    def _sampled(self, number, east_m, north_m, share):
        pixel_m = share * self.width_m / 150
        east, north = (np.mod(each / pixel_m, TEXTURE_PX).astype(np.float32) for each in (east_m, north_m))
        return cv2.remap(self.noise[number], east, north, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)

    def crossing_m(self, middle_en_m, unit):
        """From bank to bank along a line through the water; NaN where its middle is on land."""
        steps = np.linspace(0, 3 * self.width_m, 20001)
        ends = []
        for sign in (1, -1):
            places = middle_en_m + sign * steps[:, None] * unit
            beyond, _, _ = self.beyond_bank_m(places[:, 0], places[:, 1])
            first = int(np.argmax(beyond > 0))
            if first == 0:
                return math.nan
            ends.append(np.interp(0.0, beyond[first - 1 : first + 1], steps[first - 1 : first + 1]))
        return sum(ends)


PHOTOGRAPHED_LANDS = {
    "lawn": ("lake_shore.jpg", 192, 160),
    "stones": ("lake_shore.jpg", 192, 304),
    "forest": ("park_road.jpg", 48, 16),
    "dense forest": ("park_road.jpg", 48, 288),
    "meadow": ("park_road.jpg", 352, 16),
    "trees": ("park_road.jpg", 576, 112),
    "stubble": ("road_infrared.jpg", 128, 16),
    "bare field": ("road_infrared.jpg", 512, 112),
    "red soil": ("road_infrared.jpg", 80, 448),
}
PHOTOGRAPHED_WATERS = {
    "deep": ("lake_shore.jpg", 640, 64),
    "open": ("lake_shore.jpg", 640, 192),
    "calm": ("lake_shore.jpg", 640, 304),
    "shallow": ("lake_shore.jpg", 592, 176),
}
"""Squares in photographs (`pictures`): the file, and the left upper corner's pixel."""
SQUARE_PX = 128
TINTS = {"green": (1.0, 1.0, 1.0), "muddy": (0.8, 1.1, 1.5), "blue": (1.6, 1.1, 0.7), "dark": (0.6, 0.6, 0.6)}


@dataclass(frozen=True)
class PhotographedRiver(PaintedRiver):
    """A river whose land and water have the textures of photographs, with the water tinted."""

    tint: str = "green"

    def _surfaces(self, east_m, north_m, along_m, across_m):
        land = self._laid(PHOTOGRAPHED_LANDS[self.land], east_m, north_m)
        return land, self._laid(PHOTOGRAPHED_WATERS[self.water], along_m, across_m) * np.array(TINTS[self.tint])

    def _laid(self, square, east_m, north_m):
        """A square of a photograph, mirrored at its borders, about a pixel for each of the image."""
        name, left, top = square
        pixels = cv2.imread(str(Path(__file__).parent / "pictures" / name))
        assert pixels is not None
        tile = pixels[top : top + SQUARE_PX, left : left + SQUARE_PX].astype(np.float32)
        tile = np.vstack([np.hstack([tile, tile[:, ::-1]]), np.hstack([tile[::-1], tile[::-1, ::-1]])])
        east, north = (
            np.mod(each * 270 / self.width_m, 2 * SQUARE_PX).astype(np.float32) for each in (east_m, north_m)
        )
        return cv2.remap(tile, east, north, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
