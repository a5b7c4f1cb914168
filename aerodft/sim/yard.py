"""A yard with persons who walk about before a fixed camera: ``python -m aerodft.sim.yard --out yard``.

It writes ``yard.mp4``, ``station.toml`` to import it with, and ``truth.csv``: where everybody stood.
"""

import argparse
import csv
import math
import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import tomli_w

from aerodft.adapters.config.camera import camera_document
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.conventions import SECOND_NS
from aerodft.errors import AerodftError
from aerodft.geometry import camera_pose
from aerodft.model import Camera
from aerodft.service.clocks import WallClock
from aerodft.sim.live import Outlets, encode_packets, send_live, udp_sender
from aerodft.sim.scenario import EPOCH_NS, Scenario, default_camera, write_files
from aerodft.sim.trajectory import Trajectory, Waypoint, fly
from aerodft.sim.video import write_video
from aerodft.sim.world import DEFAULT_ORIGIN, Appearance, River, Walker, Wall, World

_EMPTY_YARD_S: Final = 1.5  # without persons
_FPS: Final = 10
_HEIGHT_M, _TILT_DEG, _ROLL_DEG = 5.0, 68.0, 4.0
_HOVER_M, _HOVER_PITCH_DEG = 12.0, -42.0
_STD: Final = {"height_m": 0.02, "tilt_deg": 0.1, "pan_deg": 0.1, "roll_deg": 0.1, "heading_deg": 0.5}

YARD: Final = World(
    origin=DEFAULT_ORIGIN,
    river=River(origin_en_m=(0.0, -300.0)),
    walkers=(
        Walker(start_en_m=(-9.0, 14.0), end_en_m=(9.0, 15.0)),
        Walker(start_en_m=(8.0, 17.0), end_en_m=(-8.0, 16.5), speed_mps=1.1),
        Walker(start_en_m=(-2.0, 8.5), end_en_m=(2.0, 9.0), speed_mps=0.9),
    ),
    walls=(Wall(start_en_m=(-2.0, 13.0), end_en_m=(1.0, 13.0)),),
    look=Appearance(sun_azimuth_rad=math.radians(30.0), sun_elevation_rad=math.radians(30.0)),
)
"""Two of them pass behind the wall in opposite directions, the third before it; shadows fall towards the camera."""


def write_yard(
    folder: Path,
    *,
    is_flown: bool = False,
    seconds: float | None = None,
    width_px: int = 1280,
    live: str | None = None,
    mavlink: str = "udpout:127.0.0.1:14550",
) -> None:
    """Write the files of a yard seen by a fixed camera, or by a hovering drone, whose flight's files are written too.

    Args:
        folder: Output folder, created if missing.
        is_flown: Whether it is a drone that sees it.
        seconds: Duration; None for 13.5, of a hover for 15.
        width_px: Width of the images, a multiple of 32.
        live: ``udp://HOST:PORT`` to send the images to, in real time after rendering all, without a video file.
        mavlink: ``udpout:HOST:PORT`` to send a drone's telemetry to, with ``live``.

    Raises:
        UsageError: No such address.
        LinkError: A host is unknown or unreachable.
    """
    folder.mkdir(parents=True, exist_ok=True)
    make, usual_s = (yard_flight, 15.0) if is_flown else (yard_watched, 13.5)
    scenario, video = make(seconds=seconds or usual_s, width_px=width_px), "video.mp4" if is_flown else "yard.mp4"
    source: dict[str, object] = (
        {"video": video, "start": unix_ns_to_iso(EPOCH_NS)} if live is None else {"stream": live}
    )
    with ExitStack() as stack:
        if live is not None:
            telemetry = stack.enter_context(udp_sender(mavlink)) if is_flown else None
            outlets = Outlets(telemetry=telemetry, video=stack.enter_context(udp_sender(live)))
            clock, packets = WallClock(), encode_packets(scenario)
            start_ns = (clock.now_ns() + SECOND_NS) // 1000 * 1000
            scenario = scenario.shifted(start_ns - scenario.trajectory.start_ns)
        if is_flown:
            write_files(scenario, folder, video=live is None)
        elif live is None:
            write_video(folder / video, scenario.images(), fps=_FPS)
        connection = None if live is None else mavlink.replace("udpout:", "udpin:")
        station = _flown_station(source, connection) if is_flown else _station(scenario.camera, source)
        (folder / "station.toml").write_text(tomli_w.dumps(station))
        write_truth(folder / "truth.csv", scenario.image_stamps_ns.tolist(), scenario.trajectory.start_ns)
        if live is not None:
            send_live(scenario, packets, outlets, clock)


def write_truth(path: Path, stamps_ns: list[int], start_ns: int) -> None:
    """Write the walkers' positions at stamps (host UTC) of a scene that starts at ``start_ns``."""
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["stamp_ns", "walker", "east_m", "north_m"])
        for stamp_ns in stamps_ns:
            for number, walker in enumerate(YARD.walkers, start=1):
                east, north, _ = walker.foot_enu_m((stamp_ns - start_ns) / SECOND_NS).tolist()
                rows.writerow([stamp_ns, number, f"{east:.4f}", f"{north:.4f}"])


def _station(camera: Camera, source: dict[str, object]) -> dict[str, object]:
    pose = {"height_agl_m": _HEIGHT_M, "tilt_deg": _TILT_DEG, "roll_deg": _ROLL_DEG, "heading_deg": 0.0, "std": _STD}
    return {
        "station": {"name": "yard"},
        "camera": camera_document(camera),
        "pose": pose,
        "images": source,
        "objects": {"distances_within_m": 6.0},
    }


def yard_watched(*, seconds: float, width_px: int) -> Scenario:
    """The yard before a fixed camera, without persons at first; arguments as those of ``yard_flight``."""
    pose = camera_pose(height_agl_m=_HEIGHT_M, tilt_rad=math.radians(_TILT_DEG), roll_rad=math.radians(_ROLL_DEG))
    stamps = EPOCH_NS + np.arange(round(seconds * _FPS), dtype=np.int64) * (SECOND_NS // _FPS)
    level = np.tile([1.0, 0.0, 0.0, 0.0], (2, 1))
    return Scenario(
        camera=default_camera(width_px, width_px * 9 // 16),
        world=replace(YARD, walkers=tuple(replace(each, from_s=_EMPTY_YARD_S) for each in YARD.walkers)),
        trajectory=Trajectory(
            origin=DEFAULT_ORIGIN,
            stamp_ns=stamps[[0, -1]],
            position_enu_m=np.tile(pose.position_enu_m, (2, 1)),
            ned_wxyz_body=level,
            level_wxyz_gimbal=level,
            enu_wxyz_cam=np.tile(pose.wxyz, (2, 1)),
        ),
        image_stamps_ns=stamps,
        fps=_FPS,
    )


def yard_flight(*, seconds: float = 20.0, width_px: int = 1280) -> Scenario:
    """A hover: half a metre to and fro, 6 degrees of yaw, some change of height.

    Args:
        seconds: Duration.
        width_px: Width of the images, a multiple of 32.
    """
    trajectory = _hover_trajectory(seconds)
    stamps = trajectory.start_ns + np.arange(round(seconds * _FPS), dtype=np.int64) * (SECOND_NS // _FPS)
    return Scenario(
        camera=default_camera(width_px, width_px * 9 // 16),
        world=YARD,
        trajectory=trajectory,
        image_stamps_ns=stamps,
        fps=_FPS,
    )


def _hover_trajectory(seconds: float) -> Trajectory:
    times_s = np.arange(0.0, seconds + 1.01, 1.0).tolist()
    start = Waypoint(
        time_s=0.0,
        east_m=0.0,
        north_m=0.0,
        height_m=_HOVER_M,
        heading_rad=0.0,
        gimbal_pitch_rad=math.radians(_HOVER_PITCH_DEG),
    )
    points = tuple(
        replace(
            start,
            time_s=time_s,
            east_m=0.5 * math.sin(time_s / 1.7),
            north_m=0.4 * math.sin(time_s / 2.3 + 1),
            height_m=_HOVER_M + 0.3 * math.sin(time_s / 3),
            heading_rad=math.radians(6 * math.sin(time_s / 4)),
        )
        for time_s in times_s
    )
    return fly(points, origin=DEFAULT_ORIGIN, start_ns=EPOCH_NS)


def _flown_station(source: dict[str, object], connection: str | None) -> dict[str, object]:
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


def main(arguments: list[str] | None = None) -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m aerodft.sim.yard", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="Folder for the files.")
    parser.add_argument("--live", metavar="udp://HOST:PORT", help="Send the images there, now, in real time.")
    parser.add_argument("--flown", action="store_true", help="Seen by a drone that hovers over the yard.")
    mavlink = "With --flown --live: where its telemetry goes; udpout:127.0.0.1:14550 without it."
    parser.add_argument("--mavlink", metavar="udpout:HOST:PORT", default="udpout:127.0.0.1:14550", help=mavlink)
    options = parser.parse_args(arguments)
    try:
        write_yard(options.out, is_flown=options.flown, live=options.live, mavlink=options.mavlink)
    except AerodftError as error:
        print(f"aerodft.sim.yard: {error}", file=sys.stderr)  # noqa: T201 - the command line speaks on stderr
        sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
