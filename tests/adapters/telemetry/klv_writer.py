"""Writes MISB ST 0601 local sets, by the standard's tables, and MPEG-TS videos that carry them."""

import math
import struct
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

KEY = bytes.fromhex("060e2b34020b01010e01030101000000")
# Format of struct, lowest and highest value, by tag: tables of ST 0601.
RANGES = {
    5: ("H", 0, 360),
    6: ("h", -20, 20),
    7: ("h", -50, 50),
    13: ("i", -90, 90),
    14: ("i", -180, 180),
    15: ("H", -900, 19_000),
    16: ("H", 0, 180),
    18: ("I", 0, 360),
    19: ("i", -180, 180),
    20: ("I", 0, 360),
    23: ("i", -90, 90),
    24: ("i", -180, 180),
    25: ("H", -900, 19_000),
    90: ("i", -90, 90),
    91: ("i", -90, 90),
}


def encoded(tag: int, value: float) -> bytes:
    """A value's code; NaN is the code for "out of range" of signed tags."""
    code, low, high = RANGES[tag]
    bits = 8 * struct.calcsize(code)
    if math.isnan(value):
        return struct.pack(f">{code}", -(1 << bits - 1))
    if code.islower():
        return struct.pack(f">{code}", round(value / high * (2 ** (bits - 1) - 1)))
    return struct.pack(f">{code}", round((value - low) / (high - low) * (2**bits - 1)))


def ber(length: int) -> bytes:
    if length < 128:
        return bytes([length])
    digits = length.to_bytes((length.bit_length() + 7) // 8, "big")
    return bytes([0x80 | len(digits)]) + digits


def checksum(data: bytes) -> bytes:
    """Byte by byte, as the standard's own program."""
    total = 0
    for i, byte in enumerate(data):
        total += byte << (8 * ((i + 1) % 2))
    return (total & 0xFFFF).to_bytes(2, "big")


def local_set(unix_us: int | None, values: dict[int, float], others: bytes = b"") -> bytes:
    items = b"" if unix_us is None else b"\x02\x08" + unix_us.to_bytes(8, "big")
    for tag, value in values.items():
        raw = encoded(tag, value)
        items += bytes([tag, len(raw)]) + raw
    items += others
    head = KEY + ber(len(items) + 4) + items + b"\x01\x02"
    return head + checksum(head)


def transport_stream(path: Path, sets: Sequence[bytes], rate_hz: int = 10, late_s: float = 0.0) -> None:
    """A video of grey images with a local set beside each of them."""
    with av.open(str(path), "w", format="mpegts") as out:
        video = out.add_stream("mpeg4", rate=rate_hz)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        track = out.add_data_stream("klv")
        for k, each in enumerate(sets):
            image = av.VideoFrame.from_ndarray(np.full((48, 64, 3), k % 256, dtype=np.uint8), format="rgb24")
            image.pts, image.time_base = k, Fraction(1, rate_hz)
            out.mux(video.encode(image))
            packet = av.Packet(each)
            packet.stream, packet.time_base = track, Fraction(1, 90_000)
            packet.pts = packet.dts = round((k / rate_hz + late_s) * 90_000)
            out.mux(packet)
        out.mux(video.encode())
