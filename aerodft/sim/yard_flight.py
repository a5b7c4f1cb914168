"""The yard from above: a drone that hovers over it in the wind, with its telemetry."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import tomli_w

from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.conventions import SECOND_NS
from aerodft.service.clock import WallClock
from aerodft.sim.live import Outlets, encoded, perform, udp_sender
from aerodft.sim.plan import Waypoint, fly
from aerodft.sim.scenario import EPOCH_NS, Scenario, default_camera, write_files
from aerodft.sim.trajectory import Trajectory
from aerodft.sim.world import DEFAULT_ORIGIN, World

_FPS: Final = 10
_HEIGHT_M: Final = 12.0
_PITCH_DEG: Final = -42.0
_LEAD_NS: Final = SECOND_NS


def yard_flight(world: World, *, seconds: float = 20.0, width_px: int = 1280) -> Scenario:
    """A hover: half a metre to and fro, 6 degrees of yaw, some rise and fall.

    Args:
        world: The yard.
        seconds: How long.
        width_px: Of the images, a multiple of 32.
    """
    trajectory = _hovering(seconds)
    stamps = trajectory.start_ns + np.arange(round(seconds * _FPS), dtype=np.int64) * (SECOND_NS // _FPS)
    return Scenario(
        camera=default_camera(width_px, width_px * 9 // 16),
        world=world,
        trajectory=trajectory,
        image_stamps_ns=stamps,
        fps=_FPS,
    )


def write_flight(folder: Path, scenario: Scenario) -> None:
    """Write the flight's files, and the station to import them with: ``import yard/flight.tlog --config ...``."""
    write_files(scenario, folder)
    source: dict[str, object] = {"video": "video.mp4", "start": unix_ns_to_iso(EPOCH_NS)}
    (folder / "station.toml").write_text(tomli_w.dumps(_station(source, None)))


def perform_flight(folder: Path, scenario: Scenario, video: str, mavlink: str) -> Scenario:
    """Fly it now, in real time, once all images are rendered; and when that was.

    Args:
        folder: For the files, without a video.
        scenario: The flight.
        video: ``udp://HOST:PORT``.
        mavlink: ``udpout:HOST:PORT``.

    Raises:
        UsageError: No such address.
        LinkError: A host is unknown or unreachable.
    """
    clock = WallClock()
    with udp_sender(video) as images, udp_sender(mavlink) as telemetry:
        packets = encoded(scenario)
        start_ns = (clock.now_ns() + _LEAD_NS) // 1000 * 1000
        scenario = scenario.shifted(start_ns - scenario.trajectory.start_ns)
        write_files(scenario, folder, video=False)
        listening = mavlink.replace("udpout:", "udpin:")
        (folder / "station.toml").write_text(tomli_w.dumps(_station({"stream": video}, listening)))
        perform(scenario, packets, Outlets(telemetry=telemetry, video=images), clock)
    return scenario


def _hovering(seconds: float) -> Trajectory:
    times_s = np.arange(0.0, seconds + 1.01, 1.0).tolist()
    there = Waypoint(
        time_s=0.0,
        east_m=0.0,
        north_m=0.0,
        height_m=_HEIGHT_M,
        heading_rad=0.0,
        gimbal_pitch_rad=math.radians(_PITCH_DEG),
    )
    points = tuple(
        replace(
            there,
            time_s=time_s,
            east_m=0.5 * math.sin(time_s / 1.7),
            north_m=0.4 * math.sin(time_s / 2.3 + 1),
            height_m=_HEIGHT_M + 0.3 * math.sin(time_s / 3),
            heading_rad=math.radians(6 * math.sin(time_s / 4)),
        )
        for time_s in times_s
    )
    return fly(points, origin=DEFAULT_ORIGIN, start_ns=EPOCH_NS)


def _station(source: dict[str, object], connection: str | None) -> dict[str, object]:
    telemetry: dict[str, object] = {
        "height": {"order": ["home"], "std_m": {"home": 0.1}},
        "attitude": {
            "feedback": "measured",
            "frame": "earth",
            "tilt_std_deg": 0.2,
            "pan_std_deg": 0.2,
            "roll_std_deg": 0.2,
            "heading_std_deg": 0.5,
        },
        "horizontal_std_m": 0.2,
    }
    if connection is not None:
        telemetry["connection"] = connection
    origin = {
        "lat_deg": math.degrees(DEFAULT_ORIGIN.lat_rad),
        "lon_deg": math.degrees(DEFAULT_ORIGIN.lon_rad),
        "alt_msl_m": DEFAULT_ORIGIN.alt_msl_m,
    }
    return {
        "station": {"name": "yard", "origin": origin},
        "camera": {"file": "camera.toml"},
        "telemetry": telemetry,
        "images": source,
        "objects": {},
    }
