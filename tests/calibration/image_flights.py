"""Simulated flights over landmarks: what telemetry says of each image, and what a camera that is elsewhere sees."""

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from aerodft.model import BIASES, Camera, Landmark, Pose, Prior
from calibration.flight import ImageView, PoseTrack

DEG = math.radians(1.0)
CAMERA = Camera(
    name="c", width_px=1920, height_px=1080, fx_px=1500.0, fy_px=1490.0, cx_px=955.0, cy_px=545.0,
    distortion=(-0.08, 0.02, 0.0005, -0.0003, 0.0),
)  # fmt: skip
STD = {
    "height": 1.0, "tilt": DEG, "roll": DEG, "heading": 2 * DEG, "pan": DEG, "east": 2.0, "north": 2.0, "time": 0.2,
}  # fmt: skip
"""What is stated of telemetry."""

SHARE = 0.1
"""Of that, what is new in every image."""

PRIORS = {name: Prior(value=0.0, std=std) for name, std in STD.items()}
NOISE = SHARE * np.array([STD[name] for name in ("east", "north", "height", "tilt", "pan", "roll", "heading")])


def enu_from_camera(tilt_rad, roll_rad, heading_rad):
    """Straight down with the image's up to the north; then the tilt, the heading and the roll."""
    down = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    turned = Rotation.from_euler("z", -heading_rad) * Rotation.from_matrix(down) * Rotation.from_euler("x", tilt_rad)
    return turned * Rotation.from_euler("z", roll_rad)


@dataclass(frozen=True, eq=False)
class Flight:
    """How a drone flies, and what its telemetry is off by.

    Attributes:
        biases: By name, SI units; added to what telemetry says they give the truth.
        images: How many.
        landmarks: In each.
        std_px: Of the pixels.
        tilt_deg: Of the camera, on average.
        spread_deg: By how much tilts and rolls differ.
        speed_mps: Largest.
        turn_radps: Largest.
        relief_m: Largest height of a landmark.
        noise: ``(7,)`` standard deviations of what is new in every image.
    """

    biases: dict = field(default_factory=dict)
    images: int = 8
    landmarks: int = 6
    std_px: float = 0.7
    tilt_deg: float = 40.0
    spread_deg: float = 8.0
    height_m: float = 50.0
    speed_mps: float = 6.0
    turn_radps: float = 0.25
    relief_m: float = 4.0
    noise: np.ndarray = field(default_factory=lambda: NOISE)

    def views(self, rng):
        """The images, with what is seen in each of them."""
        return tuple(self._view(f"IMG_{index}", rng) for index in range(self.images))

    def _view(self, name, rng):
        angles = np.radians(
            [self.tilt_deg, 0.0, 0.0] + rng.uniform(-1, 1, 3) * [self.spread_deg, self.spread_deg / 2, 180.0]
        )
        position = np.array([*rng.normal(size=2) * 15, self.height_m * rng.uniform(0.8, 1.2)])
        velocity = rng.uniform(-1, 1, 3) * self.speed_mps * [1, 1, 0.3]
        rate = rng.uniform(-1, 1, 3) * self.turn_radps
        attitude = enu_from_camera(*angles)
        quaternion = np.roll(attitude.as_quat(), 1)
        pose = Pose(position_enu_m=position, wxyz=quaternion, velocity_enu_mps=velocity, rate_cam_radps=rate)
        track = PoseTrack.at_constant_rates(pose, 2.0)
        off = {name: self.biases.get(name, 0.0) for name in BIASES}
        new = rng.normal(size=7) * self.noise
        after = off["time"]
        truly_m = position + after * velocity + [off["east"], off["north"], off["height"]] + new[:3]
        turned = attitude * Rotation.from_rotvec(after * rate)
        turned = turned * Rotation.from_rotvec([off["tilt"], off["pan"], off["roll"]])
        turned = Rotation.from_rotvec([0.0, 0.0, -off["heading"] - new[6]]) * turned * Rotation.from_rotvec(new[3:6])
        return ImageView(name, self._seen(name, truly_m, turned, rng), track, self.noise)

    def _seen(self, image, position_m, attitude, rng):
        """Landmarks anywhere in the image, as OpenCV sees them."""
        lens = np.array([[CAMERA.fx_px, 0, CAMERA.cx_px], [0, CAMERA.fy_px, CAMERA.cy_px], [0, 0, 1.0]])
        found: list = []
        while len(found) < self.landmarks:
            wanted = rng.uniform([60, 60], [CAMERA.width_px - 60, CAMERA.height_px - 60])
            ray = attitude.apply([*((wanted - lens[:2, 2]) / [CAMERA.fx_px, CAMERA.fy_px]), 1.0])
            if ray[2] > -0.15:
                continue
            up = rng.uniform(0, self.relief_m)
            point = position_m + ray * (up - position_m[2]) / ray[2]
            turn = attitude.inv().as_rotvec()
            shift = attitude.inv().apply(-position_m)
            pixel = cv2.projectPoints(point.reshape(1, 3), turn, shift, lens, np.array(CAMERA.distortion))[0].ravel()
            pixel = pixel + self.std_px * rng.normal(size=2)
            name = f"{image}/p{len(found)}"
            found.append(Landmark(name=name, pixel=tuple(pixel), position_m=tuple(point), std_px=self.std_px or 1.0))
        return tuple(found)


def drawn(rng, names=BIASES):
    """Biases as telemetry's stated standard deviations say."""
    shared = math.sqrt(1 - SHARE**2)
    return {name: shared * STD[name] * rng.normal() for name in names}
