"""Moved stamps: every one of a payload's by the same amount, and nothing else."""

import struct

import orjson
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.timestamp_pb2 import Timestamp
from mcap_protobuf.schema import build_file_descriptor_set

from aerodft.adapters.recording import Channel
from aerodft.adapters.wire.schemas import schema_text
from replay.player.publish import shift_of, shift_stamps

STAMP_NS, HOUR_NS = 1_795_221_278_868_833_001, 3_600_000_000_000


def test_every_stamp_of_ours_is_moved_and_all_else_is_the_same_to_the_byte() -> None:
    payload = (
        b'{"schema":"aerodft.camera_motion/1","stamp_ns":"%d","since_ns":"%d","moved_ns":null,"wait_ns":"5","n":1.50,'
        b'"reasons":["turned by 0.31 deg since 2026-11-21T00:34:38Z, at 2026-11-21T23:34:38.250Z"]}'
    ) % (STAMP_NS, STAMP_NS - 7)
    assert shift_stamps(payload, HOUR_NS) == (
        b'{"schema":"aerodft.camera_motion/1","stamp_ns":"%d","since_ns":"%d","moved_ns":null,"wait_ns":"5","n":1.50,'
        b'"reasons":["turned by 0.31 deg since 2026-11-21T01:34:38Z, at 2026-11-22T00:34:38.250Z"]}'
    ) % (STAMP_NS + HOUR_NS, STAMP_NS - 7 + HOUR_NS)
    assert shift_stamps(shift_stamps(payload, HOUR_NS), -HOUR_NS) == payload
    assert shift_stamps(payload, 0) is payload
    endless = b'{"stamp_ns":"%s"}' % (b"9" * 5000)
    assert shift_stamps(endless, HOUR_NS) == endless


@pytest.mark.parametrize(
    "schema", ["measurement/1", "pose/1", "status/1", "image/1", "camera_motion/1", "height_switch/1", "observation/1"]
)
def test_no_schema_has_a_stamp_that_would_stay(schema: str) -> None:
    names = set[str]()

    def walk(item: object) -> None:
        if isinstance(item, dict):
            names.update(key for key in item if key.endswith("_ns"))
            for each in item.values():
                walk(each)

    walk(orjson.loads(schema_text(f"aerodft.{schema}")))
    for name in names:
        assert shift_stamps(b'{"%s":"5"}' % name.encode(), 1) == b'{"%s":"6"}' % name.encode()


def channel(encoding: str, schema: str = "", data: bytes = b"") -> Channel:
    return Channel(topic="/t", encoding=encoding, schema=schema, schema_data=data)


def test_stamps_of_other_tools_are_moved_where_their_schema_says_they_are() -> None:
    text = build_file_descriptor_set(CompressedImage).SerializeToString()
    move = shift_of(channel("protobuf", "foxglove.CompressedImage", text))
    image = CompressedImage(timestamp=Timestamp(seconds=10, nanos=999_999_999), frame_id="c", data=b"x", format="jpeg")
    assert move is not None
    moved = CompressedImage.FromString(move(image.SerializeToString(), 2))
    assert (moved.timestamp.seconds, moved.timestamp.nanos, moved.frame_id, moved.data) == (11, 1, "c", b"x")
    json = shift_of(channel("json"))
    assert json is not None
    assert orjson.loads(json(b'{"a": {"stamp": {"sec": 1, "nsec": 999999999}, "sec": 1}}', 1)) == {
        "a": {"stamp": {"sec": 2, "nsec": 0}, "sec": 1}
    }
    head = b"# a comment\nstd_msgs/Header header\nfloat64 x\n"
    for encoding, before, order in (("cdr", b"\0\1\0\0", "<"), ("cdr", b"\0\0\0\0", ">"), ("ros1", b"\7\0\0\0", "<")):
        ros = shift_of(channel(encoding, "a/B", head))
        assert ros is not None
        stamped = before + struct.pack(f"{order}II", 10, 999_999_999) + b"rest"
        assert ros(stamped, 1) == before + struct.pack(f"{order}II", 11, 0) + b"rest"
    assert shift_of(channel("cdr", "a/B", b"float64 x\n")) is None
    assert shift_of(channel("flatbuffer")) is None


FARTHEST = b"\xff" * 8  # of a ROS header: the last second that its 32 bits hold
NESTED = b'{"a":' * 900 + b"1" + b"}" * 900


@pytest.mark.parametrize(
    ("made", "payload"),
    [
        (channel("json"), NESTED),
        (channel("json"), b"[" * 300 + b"]" * 300),
        (channel("json"), b'{"sec":18446744073709551615,"nsec":0}'),
        (channel("cdr", data=b"std_msgs/Header header"), b"\0\1\0\0" + FARTHEST),
        (channel("ros1", data=b"Header header"), b"\0\0\0\0" + FARTHEST),
        (
            channel(
                "protobuf", "foxglove.CompressedImage", build_file_descriptor_set(CompressedImage).SerializeToString()
            ),
            CompressedImage(timestamp=Timestamp(seconds=2**63 - 1)).SerializeToString(),
        ),
    ],
    ids=["nested", "list", "json", "ros2", "ros1", "protobuf"],
)
def test_what_cannot_be_moved_so_far_stays_as_it_was(made: Channel, payload: bytes) -> None:
    move = shift_of(made)
    assert move is not None
    assert move(payload, HOUR_NS) == payload
