"""A log format of somebody else's: a text table of the height above the ground and of the camera's tilt."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from aerodft.adapters.telemetry.mavlink import FollowedIds, FrameCounts
from aerodft.geometry import from_yaw_pitch_roll
from aerodft.model import ClockTrack, Event, GimbalSource, GimbalTrack, HeightSource, HeightTrack, RawBlock, Track
from aerodft.service import block_of

PROTOCOL = "height-table"
TITLE = "a table of heights and tilts"
_HEADER = b"unix_s,height_m,tilt_deg\n"


def recognises(head: bytes) -> bool:
    return head.startswith(_HEADER)


def open_source(path: Path) -> "HeightTable":
    return HeightTable(path)


def new_decoder(followed: FollowedIds) -> "HeightTableDecoder":
    del followed
    return HeightTableDecoder()


class HeightTable:
    """Each line is a frame; it arrives at its time."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lines = path.read_bytes().removeprefix(_HEADER).splitlines()
        self.counts = FrameCounts(frames=len(self._lines))

    def events(self) -> Iterator[Event]:
        arrivals_ns = [int(float(line.split(b",")[0]) * 1e9) for line in self._lines]
        yield block_of(PROTOCOL, self._path.name, arrivals_ns, self._lines)

    def warnings(self) -> tuple[str, ...]:
        return ()


class HeightTableDecoder:
    def __init__(self) -> None:
        self.rejected: Counter[str] = Counter()

    def decode(self, block: RawBlock) -> tuple[Track, ...]:
        frames = (block.data[start : start + size] for start, size in zip(block.offset, block.length, strict=True))
        unix_s, height_m, tilt_deg = np.array([line.split(b",") for line in frames], dtype=np.float64).T
        level, unix_ns = np.zeros(len(unix_s)), np.round(unix_s * 1e9).astype(np.int64)
        stamps = {"arrival_ns": block.arrival_ns, "boot_ns": unix_ns % 10**15}  # any steady count will do
        return (
            ClockTrack(unix_ns=unix_ns, **stamps),
            HeightTrack(
                source=HeightSource.TERRAIN, value_m=height_m, slant=False, std_m=np.full(len(height_m), 0.1), **stamps
            ),
            GimbalTrack(
                source=GimbalSource.MOUNT_ORIENTATION,
                wxyz=from_yaw_pitch_roll(level, np.radians(tilt_deg - 90.0), level),
                yaw_in_earth=np.ones(len(level), dtype=np.bool_),
                **stamps,
            ),
        )
