"""A yard with persons who walk about before a fixed camera: ``python -m aerodft.sim.yard --out yard``.

It writes ``yard.mp4``, ``station.toml`` to import it with, and ``truth.csv``: where everybody stood.
"""

import argparse
import csv
import math
import sys
from collections.abc import Iterator
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
from aerodft.model import Camera, ImageArray
from aerodft.service.clocks import WallClock
from aerodft.sim.live import Outlets, encode_packets, send_live, udp_sender
from aerodft.sim.render import Renderer, SensorModel
from aerodft.sim.scenario import EPOCH_NS, Scenario, default_camera, write_files
from aerodft.sim.trajectory import Trajectory, Waypoint, fly
from aerodft.sim.video import TransportStream, write_video
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


def write_yard(folder: Path, *, seconds: float = 13.5, width_px: int = 1280, live: str | None = None) -> None:
    """Write the files of a yard seen by a fixed camera.

    Args:
        folder: Output folder, created if missing.
        seconds: Duration of the video.
        width_px: Width of the images, a multiple of 32.
        live: ``udp://HOST:PORT`` to send the images to, in real time, without a video file.

    Raises:
        UsageError: No such address.
        LinkError: The host is unknown or unreachable.
    """
    camera = default_camera(width_px, width_px * 9 // 16)
    folder.mkdir(parents=True, exist_ok=True)
    source: dict[str, object]
    if live is None:
        write_video(folder / "yard.mp4", _images(camera, seconds, EPOCH_NS), fps=_FPS)
        start_ns, source = EPOCH_NS, {"video": "yard.mp4", "start": unix_ns_to_iso(EPOCH_NS)}
    else:
        start_ns, source = _send_images(camera, seconds, live), {"stream": live}
    (folder / "station.toml").write_text(tomli_w.dumps(_station(camera, source)))
    write_truth(
        folder / "truth.csv", [start_ns + k * SECOND_NS // _FPS for k in range(round(seconds * _FPS))], start_ns
    )


def write_flown_yard(
    folder: Path,
    *,
    seconds: float = 15.0,
    width_px: int = 1280,
    live: str | None = None,
    mavlink: str = "udpout:127.0.0.1:14550",
) -> None:
    """Write the files of a yard seen by a hovering drone: flight.tlog, video.mp4, station.toml, truth.csv and others.

    Args:
        folder: Output folder, created if missing.
        seconds: Duration of the hover.
        width_px: Width of the images, a multiple of 32.
        live: ``udp://HOST:PORT`` to send the images to, in real time, without a video file.
        mavlink: ``udpout:HOST:PORT`` to send the telemetry to, with ``live``.

    Raises:
        UsageError: No such address.
        LinkError: A host is unknown or unreachable.
    """
    folder.mkdir(parents=True, exist_ok=True)
    scenario = yard_flight(seconds=seconds, width_px=width_px)
    if live is None:
        _write_flight(folder, scenario)
    else:
        scenario = _fly_live(folder, scenario, live, mavlink)
    write_truth(folder / "truth.csv", scenario.image_stamps_ns.tolist(), scenario.trajectory.start_ns)


def write_truth(path: Path, stamps_ns: list[int], start_ns: int) -> None:
    """Write the walkers' positions at stamps (host UTC) of a scene that starts at ``start_ns``."""
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["stamp_ns", "walker", "east_m", "north_m"])
        for stamp_ns in stamps_ns:
            for number, walker in enumerate(YARD.walkers, start=1):
                east, north, _ = walker.foot_enu_m((stamp_ns - start_ns) / SECOND_NS).tolist()
                rows.writerow([stamp_ns, number, f"{east:.4f}", f"{north:.4f}"])


def _images(camera: Camera, seconds: float, start_ns: int) -> Iterator[tuple[int, ImageArray]]:
    pose = camera_pose(height_agl_m=_HEIGHT_M, tilt_rad=math.radians(_TILT_DEG), roll_rad=math.radians(_ROLL_DEG))
    noise = SensorModel(noise_std=2.0)
    empty, full = Renderer(camera, replace(YARD, walkers=()), noise), Renderer(camera, YARD, noise)
    for k in range(round(seconds * _FPS)):
        time_s = k / _FPS
        yield start_ns + k * SECOND_NS // _FPS, (empty if time_s < _EMPTY_YARD_S else full).render(pose, time_s)


def _send_images(camera: Camera, seconds: float, address: str) -> int:
    """Send the images in real time after rendering all; returns the start (host UTC)."""
    clock = WallClock()
    with TransportStream(_FPS) as stream, udp_sender(address) as send:
        packets = [stream.encode(image, after_ns) for after_ns, image in _images(camera, seconds, 0)]
        start_ns = clock.now_ns() + SECOND_NS
        for k, datagrams in enumerate(packets):
            clock.sleep_until(start_ns + k * SECOND_NS // _FPS)
            for each in datagrams:
                send(each)
    return start_ns


def _station(camera: Camera, source: dict[str, object]) -> dict[str, object]:
    pose = {"height_agl_m": _HEIGHT_M, "tilt_deg": _TILT_DEG, "roll_deg": _ROLL_DEG, "heading_deg": 0.0, "std": _STD}
    return {
        "station": {"name": "yard"},
        "camera": camera_document(camera),
        "pose": pose,
        "images": source,
        "objects": {"distances_within_m": 6.0},
    }


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


def _write_flight(folder: Path, scenario: Scenario) -> None:
    """Write the flight's files, and a station file to import them with."""
    write_files(scenario, folder)
    source: dict[str, object] = {"video": "video.mp4", "start": unix_ns_to_iso(EPOCH_NS)}
    (folder / "station.toml").write_text(tomli_w.dumps(_flown_station(source, None)))


def _fly_live(folder: Path, scenario: Scenario, video: str, mavlink: str) -> Scenario:
    """Fly in real time after rendering all images; writes the files, and returns the flight shifted to its time."""
    clock = WallClock()
    with udp_sender(video) as images, udp_sender(mavlink) as telemetry:
        packets = encode_packets(scenario)
        start_ns = (clock.now_ns() + SECOND_NS) // 1000 * 1000
        scenario = scenario.shifted(start_ns - scenario.trajectory.start_ns)
        write_files(scenario, folder, video=False)
        connection = mavlink.replace("udpout:", "udpin:")
        (folder / "station.toml").write_text(tomli_w.dumps(_flown_station({"stream": video}, connection)))
        send_live(scenario, packets, Outlets(telemetry=telemetry, video=images), clock)
    return scenario


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
        if options.flown:
            write_flown_yard(options.out, live=options.live, mavlink=options.mavlink)
        else:
            write_yard(options.out, live=options.live)
    except AerodftError as error:
        print(f"aerodft.sim.yard: {error}", file=sys.stderr)  # noqa: T201 - the command line speaks on stderr
        sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
