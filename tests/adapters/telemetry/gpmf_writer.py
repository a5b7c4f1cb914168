"""Writes GoPro's GPMF payloads, by the published format, and MP4 videos that carry them."""

import struct
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

EPOCH = datetime(2000, 1, 1, tzinfo=UTC)


def item(key: str, kind: str, size: int, count: int, data: bytes) -> bytes:
    code = 0 if kind == "" else ord(kind)
    return key.encode() + struct.pack(">BBH", code, size, count) + data + bytes(-len(data) % 4)


def nest(key: str, *parts: bytes) -> bytes:
    data = b"".join(parts)
    return key.encode() + struct.pack(">BBH", 0, 1, len(data)) + data


def gps5(at: datetime, places: Sequence[tuple[float, float, float]], fix: int = 3, dop: float = 1.5) -> bytes:
    """A payload of GPS5, as HERO5 to HERO10 write it."""
    samples = b"".join(
        struct.pack(">5i", round(lat * 1e7), round(lon * 1e7), round(alt * 1e3), 1000, 100) for lat, lon, alt in places
    )
    gravity = nest("STRM", item("SCAL", "s", 2, 1, struct.pack(">h", 32767)), item("GRAV", "s", 6, 1, bytes(6)))
    text = at.strftime("%y%m%d%H%M%S") + f".{at.microsecond // 1000:03d}"
    places_stream = nest(
        "STRM",
        item("TSMP", "L", 4, 1, struct.pack(">I", len(places))),
        item("GPSF", "L", 4, 1, struct.pack(">I", fix)),
        item("GPSU", "U", 16, 1, text.encode()),
        item("GPSP", "S", 2, 1, struct.pack(">H", round(dop * 100))),
        item("UNIT", "c", 3, 5, b"degdegm\0\0m/sm/s"),
        item("SCAL", "l", 4, 5, struct.pack(">5i", 10_000_000, 10_000_000, 1000, 1000, 100)),
        item("GPS5", "l", 20, len(places), samples),
    )
    return nest("DEVC", item("DVNM", "c", 1, 6, b"Camera"), gravity, places_stream)


def gps9(at: datetime, places: Sequence[tuple[float, float, float]], step_s: float, fix: int = 3) -> bytes:
    """A payload of GPS9, as HERO11 and later write it: each sample with its own time."""
    samples = b""
    for k, (lat, lon, alt) in enumerate(places):
        since = at + timedelta(seconds=k * step_s) - EPOCH
        day_ms = since.seconds * 1000 + since.microseconds // 1000
        values = (round(lat * 1e7), round(lon * 1e7), round(alt * 1e3), 1000, 100, since.days, day_ms)
        samples += struct.pack(">7i2H", *values, 150, fix)
    scales = struct.pack(">9i", 10_000_000, 10_000_000, 1000, 1000, 100, 1, 1000, 100, 1)
    stream = nest(
        "STRM",
        item("TYPE", "c", 1, 9, b"lllllllSS"),
        item("SCAL", "l", 4, 9, scales),
        item("GPS9", "?", 32, len(places), samples),
    )
    return nest("DEVC", stream)


def video(path: Path, payloads: Sequence[bytes], rate_hz: int = 5) -> None:
    """An MP4 of grey images with one payload per second."""
    with av.open(str(path), "w", format="mp4") as out:
        stream = out.add_stream("mpeg4", rate=rate_hz)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        track = out.add_data_stream("bin_data")
        track.metadata["handler_name"] = "GoPro MET"
        for k in range(len(payloads) * rate_hz):
            image = av.VideoFrame.from_ndarray(np.full((48, 64, 3), k % 256, dtype=np.uint8), format="rgb24")
            image.pts, image.time_base = k, Fraction(1, rate_hz)
            out.mux(stream.encode(image))
        out.mux(stream.encode())
        for k, each in enumerate(payloads):
            packet = av.Packet(each)
            packet.stream, packet.time_base = track, Fraction(1, 1000)
            packet.pts = packet.dts = k * 1000
            packet.duration = 1000
            out.mux(packet)
