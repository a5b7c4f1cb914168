"""Random flights over the simulated river, filmed by a camera with a clock of its own, and their true alignment."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import PoseStd
from aerodft.sim import Autopilot, Waypoint, datagrams, default_camera, fly
from aerodft.sim.render import SensorModel
from aerodft.sim.scenario import EPOCH_NS, Scenario
from aerodft.sim.telemetry import Radio, draw_biases, through_radio, write_tlog
from aerodft.sim.trajectory import Trajectory, survey
from aerodft.sim.video import write_video
from aerodft.sim.world import DEFAULT_ORIGIN, River, furnished_world

MARGIN_S = 20.0
RIVER = River(origin_en_m=(0.0, -26.0))
_LEG_S = 5.0


@dataclass(frozen=True)
class Clocks:
    """How a clip is misaligned: stamps of the video become UTC by offset and drift, the gimbal lags its reports."""

    offset_s: float
    drift: float
    lag_s: float

    @classmethod
    def drawn(cls, seed: int) -> "Clocks":
        rng = np.random.default_rng([seed, 5])
        return cls(float(rng.uniform(-20, 20)), float(rng.uniform(-0.02, 0.02)), float(rng.uniform(0.05, 0.3)))

    def video_ns(self, utc_ns: np.ndarray, reference_utc_ns: int) -> np.ndarray:
        """Stamps that the video has for images taken at these times; the offset holds at the reference."""
        since = (utc_ns - reference_utc_ns) / (1 + self.drift)
        return np.rint(reference_utc_ns - self.offset_s * SECOND_NS + since).astype(np.int64)


def wandering(seed: int, duration_s: float) -> Trajectory:
    """Legs of 5 s in all directions, the gimbal up and down, with pauses."""
    rng = np.random.default_rng([seed, 3])
    place, heading, pitch = np.array([0.0, 0.0, 35.0]), 0.3, math.radians(-60)
    waypoints = []
    for time_s in np.arange(0, duration_s + _LEG_S, _LEG_S).tolist():
        if rng.random() > 0.3:
            heading += math.radians(rng.normal(0, 35))
            pitch = math.radians(rng.uniform(-90, -40))
        place = place + rng.normal(0, [8, 6, 3])
        place[2] = np.clip(place[2], 20, 60)
        east, north, height = place.tolist()
        waypoints.append(
            Waypoint(
                time_s=time_s,
                east_m=east,
                north_m=north,
                height_m=height,
                heading_rad=heading,
                gimbal_pitch_rad=pitch,
                gimbal_yaw_rad=math.radians(rng.normal(0, 5)),
            )
        )
    return fly(tuple(waypoints), origin=DEFAULT_ORIGIN, start_ns=EPOCH_NS)


def hovering(duration_s: float) -> Trajectory:
    """In place, with the gimbal locked."""
    waypoints = tuple(
        Waypoint(time_s=time_s, east_m=0, north_m=0, height_m=40, heading_rad=0.4, gimbal_pitch_rad=-1.1)
        for time_s in (0.0, duration_s / 2, duration_s)
    )
    return fly(waypoints, origin=DEFAULT_ORIGIN, start_ns=EPOCH_NS)


def flight(seed: int, duration_s: float = 60.0) -> tuple[Trajectory, float]:
    """A survey or a wandering, in turns, and by how much (s) it is longer than the clip at both ends."""
    if seed % 2:
        return wandering(seed, duration_s + 2 * MARGIN_S), MARGIN_S
    return survey(RIVER, origin=DEFAULT_ORIGIN, duration_s=duration_s, start_ns=EPOCH_NS), 0.0


def scenario(
    trajectory: Trajectory, seed: int, clocks: Clocks, *, margin_s: float, size=(640, 360), fps=10.0
) -> Scenario:
    """The flight with its errors, filmed but for ``margin_s`` at both ends."""
    margin_ns = round(margin_s * SECOND_NS)
    stamps = np.arange(
        trajectory.start_ns + margin_ns, trajectory.end_ns - margin_ns, round(SECOND_NS / fps), dtype=np.int64
    )
    std = PoseStd(
        height_agl_m=0.5,
        tilt_rad=math.radians(0.7),
        pan_rad=math.radians(0.5),
        roll_rad=math.radians(0.5),
        heading_rad=math.radians(2.0),
    )
    noise = PoseStd(
        tilt_rad=math.radians(0.02),
        pan_rad=math.radians(0.02),
        roll_rad=math.radians(0.02),
        heading_rad=math.radians(0.05),
    )
    return Scenario(
        camera=default_camera(*size),
        world=furnished_world(RIVER, seed=seed),
        trajectory=trajectory,
        image_stamps_ns=stamps,
        fps=fps,
        autopilot=Autopilot(
            gimbal_lag_ns=round(clocks.lag_s * SECOND_NS), biases=draw_biases(std, seed), noise=noise, seed=seed
        ),
        radio=Radio(latency_ns=20_000_000, jitter_ns=5_000_000, drop=0.01, seed=seed),
        imaging=SensorModel(seed=seed),
    )


def write_log(told: Scenario, path: Path) -> None:
    write_tlog(path, through_radio(datagrams(told.trajectory, told.autopilot), told.radio))


def write_clip(filmed: Scenario, clocks: Clocks, path: Path) -> int:
    """The video with the stamps of its own clock; returns the reference at which the offset holds, by that clock."""
    utc = filmed.image_stamps_ns
    middle = int((utc[0] + utc[-1]) // 2)
    stamps = clocks.video_ns(utc, middle)
    images = zip(stamps.tolist(), (pixels for _, pixels in filmed.images()), strict=True)
    write_video(path, images, fps=filmed.fps)
    return middle - round(clocks.offset_s * SECOND_NS)
