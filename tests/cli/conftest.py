"""A command line without a process for each call, and small flights to feed it with."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import orjson
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.commands import Run, run_aerodft

UTC0_NS = 1_795_221_168_000_000_000
HEIGHT_M, PITCH_DEG = 40.0, -60.0
WIDTH_PX, HEIGHT_PX = 64, 48

CAMERA = f"""
name = "small"
width_px = {WIDTH_PX}
height_px = {HEIGHT_PX}
hfov_deg = 60.0
"""
STATION = """
[station]
name = "test"
[camera]
file = "camera.toml"
[telemetry.height]
order = ["home"]
[images]
rate_hz = 5
[[probe]]
name = "centre"
kind = "range"
pixels = [[31.5, 23.5]]
[[probe]]
name = "width"
kind = "distance"
observed = true
"""


@pytest.fixture(scope="session")
def aerodft() -> Callable[..., Run]:
    return run_aerodft


def write_tlog(
    path: Path, seconds: float = 3.0, *, gimbal: bool = True, height: bool = True, start_s: float = 0.0
) -> Path:
    """A hover 40 m above home, gimbal at -60 deg, 10 Hz; host stamps are UTC plus 20 ms."""
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    down = math.radians(PITCH_DEG) / 2
    log = bytearray()

    def put(boot_ms: int, *messages: dialect.MAVLink_message) -> None:
        for message in messages:
            log.extend((UTC0_NS // 1000 + boot_ms * 1000 + 20_000).to_bytes(8, "big") + message.pack(mav))

    first_ms = round(start_s * 1000)
    put(first_ms, dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3))
    for boot_ms in range(first_ms, first_ms + round(seconds * 1000) + 1, 100):
        put(
            boot_ms,
            dialect.MAVLink_system_time_message(UTC0_NS // 1000 + boot_ms * 1000, boot_ms),
            dialect.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 0.5, 0, 0, 0),
        )
        if height:
            put(
                boot_ms,
                dialect.MAVLink_global_position_int_message(
                    boot_ms, -353_600_000, 1_491_600_000, 640_000, round(HEIGHT_M * 1000), 0, 0, 0, 0
                ),
            )
        if gimbal:
            q = [math.cos(down), 0.0, math.sin(down), 0.0]
            put(
                boot_ms,
                dialect.MAVLink_gimbal_device_attitude_status_message(
                    0, 0, boot_ms, 44, q, math.nan, math.nan, math.nan, 0
                ),
            )
    path.write_bytes(log)
    return path


def write_video(
    path: Path,
    images: int = 10,
    *,
    fps: int = 5,
    size: tuple[int, int] = (WIDTH_PX, HEIGHT_PX),
    start: str | None = None,
) -> Path:
    """A grey video; ``start`` is the UTC that its container states."""
    with av.open(str(path), "w") as container:
        if start is not None:
            container.metadata["creation_time"] = start
        stream = container.add_stream("libx264", rate=Fraction(fps))
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        for index in range(images):
            pixels = np.full((size[1], size[0], 3), 20 + 10 * index, dtype=np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, format="bgr24")))
        container.mux(stream.encode())
    return path


@dataclass(frozen=True)
class Desk:
    """A folder with a camera, a station file and a log, and ways to make more."""

    folder: Path

    @property
    def config(self) -> Path:
        return self.folder / "station.toml"

    @property
    def log(self) -> Path:
        return self.folder / "flight.tlog"

    def station(self, text: str = STATION, name: str = "station.toml") -> Path:
        path = self.folder / name
        path.write_text(text)
        return path

    def tlog(self, name: str = "flight.tlog", **flight: Any) -> Path:
        return write_tlog(self.folder / name, **flight)

    def video(self, name: str = "flight.mp4", **video: Any) -> Path:
        return write_video(self.folder / name, **video)

    def observations(self, *lines: object, name: str = "seen.jsonl") -> Path:
        path = self.folder / name
        path.write_bytes(b"\n".join(line if isinstance(line, bytes) else orjson.dumps(line) for line in lines))
        return path


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    made = Desk(tmp_path)
    (tmp_path / "camera.toml").write_text(CAMERA)
    made.station()
    made.tlog()
    return made


@pytest.fixture(scope="session")
def flight_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short flight, imported with its video and with observations of a width in every second image."""
    made = Desk(tmp_path_factory.mktemp("flight"))
    (made.folder / "camera.toml").write_text(CAMERA)
    seen = made.observations(*({"name": "width", "image": k, "pixels": [[10, 24], [50, 24]]} for k in range(0, 10, 2)))
    folder = made.folder / "recording"
    run = run_aerodft(
        "import", made.tlog(), "--video", made.video(), "--video-start", "2026-11-21T00:32:48.55Z",
        "-c", made.station(), "-o", folder, "--observations", seen,
    )  # fmt: skip
    assert run.code == 0, run.err
    return folder
