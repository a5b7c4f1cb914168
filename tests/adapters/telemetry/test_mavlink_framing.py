import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.generator.mavcrc import x25crc

from aerodft.adapters.telemetry.mavlink import (
    MESSAGES,
    StreamFramer,
    checksum,
    frame_table,
    message_name,
    payload_dtype,
)


@settings(deadline=None)  # the first call compiles
@given(st.binary(max_size=280), st.integers(0, 255))
def test_checksum_is_pymavlinks(data: bytes, extra: int) -> None:
    theirs = x25crc(data + bytes([extra])).crc
    assert checksum(np.frombuffer(data, dtype=np.uint8), 0, len(data), extra) == theirs


def _base_lengths_of_the_xml() -> dict[int, int]:
    folder = Path(dialect.__file__).parent
    sizes = {"char": 1, "int8_t": 1, "uint8_t": 1, "int16_t": 2, "uint16_t": 2, "int32_t": 4, "uint32_t": 4}
    sizes |= {"float": 4, "int64_t": 8, "uint64_t": 8, "double": 8, "uint8_t_mavlink_version": 1}
    lengths = {}
    for file in folder.glob("*.xml"):
        for message in ET.parse(file).getroot().iter("message"):  # noqa: S314 - pymavlink's own files
            total = 0
            for child in message:
                if child.tag == "extensions":
                    break
                if child.tag == "field":
                    name, _, count = child.attrib["type"].partition("[")
                    total += sizes[name] * int(count.rstrip("]") or 1)
            if message_name(int(message.attrib["id"])) == message.attrib["name"]:
                lengths[int(message.attrib["id"])] = total
    return lengths


def test_base_lengths_are_the_definitions_but_for_chance_matches() -> None:
    truth = _base_lengths_of_the_xml()
    if not truth:
        pytest.skip("pymavlink came without its XML definitions")
    assert len(truth) == len(MESSAGES)
    table = frame_table()
    ours = {i: int(table[i] >> 8 & 0xFF) for i in truth}
    assert all(ours[i] <= truth[i] for i in truth)  # a valid MAVLink 1 frame is never refused
    assert sum(ours[i] != truth[i] for i in truth) < len(truth) * 0.02


def test_payload_types_have_pymavlinks_sizes() -> None:
    for message_id, message in MESSAGES.items():
        assert payload_dtype(message_id).itemsize == message.unpacker.size


@settings(deadline=None)  # the first call compiles
@given(st.lists(st.integers(1, 90), min_size=1, max_size=30))
def test_frames_do_not_depend_on_how_bytes_are_cut(flight_frames: list[bytes], cuts: list[int]) -> None:
    stream = b"".join(flight_frames)
    framer, found, at = StreamFramer(), [], 0
    while at < len(stream):
        step = cuts[len(found) % len(cuts)]
        found += framer.push(stream[at : at + step])
        at += step
    assert found == flight_frames
    assert framer.counts.frames == len(flight_frames)
    assert framer.counts.skipped_bytes == 0


def test_counts_say_what_was_met(flight_frames: list[bytes], pack: Callable[..., bytes]) -> None:
    wrong = bytearray(flight_frames[1])
    wrong[-1] ^= 1
    alien = bytearray(pack(dialect.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3)))
    alien[7:10] = (60_000).to_bytes(3, "little")
    framer = StreamFramer()
    stream = flight_frames[0] + bytes(wrong) + flight_frames[2] + bytes(alien) + flight_frames[3] + flight_frames[4][:9]
    found = framer.push(stream) + framer.flush()
    assert found == [flight_frames[0], flight_frames[2], flight_frames[3]]
    counts = framer.counts
    assert (counts.frames, counts.bad_crc, counts.unknown, counts.truncated) == (3, 1, 1, 1)
    assert counts.skipped_bytes == len(wrong) + 9


def test_signed_frames_are_whole(pack: Callable[..., bytes]) -> None:
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    mav.signing.secret_key = bytes(range(32))
    mav.signing.sign_outgoing = True
    signed = bytes(dialect.MAVLink_attitude_message(1, 0.1, 0.2, 0.3, 0, 0, 0).pack(mav))
    plain = pack(dialect.MAVLink_attitude_message(1, 0.1, 0.2, 0.3, 0, 0, 0))
    assert len(signed) == len(plain) + 13
    assert StreamFramer().push(plain + signed + plain) == [plain, signed, plain]


def test_unknown_incompatibility_flags_are_refused(pack: Callable[..., bytes]) -> None:
    frame = bytearray(pack(dialect.MAVLink_attitude_message(1, 0.1, 0.2, 0.3, 0, 0, 0)))
    frame[2] = 2
    body = bytes(frame[1:-2])
    frame[-2:] = x25crc(body + bytes([39])).crc.to_bytes(2, "little")
    assert StreamFramer().push(bytes(frame)) == []
