"""What other tools write is read as they mean it; the ROS messages are bytes that the package ``rosbags`` wrote."""

import base64
import json
import math
from contextlib import suppress

import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.timestamp_pb2 import Timestamp
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.recording import Channel
from replay.foreign import ChannelKind, FrameReader, kind_of, read_encoded_image
from replay.foreign.messages import read_camera

STAMP_NS = 1_795_221_278_868_833_001
JPEG = bytes.fromhex("ffd8ff00")
# ATTITUDE 12345 ms, 0.1, -0.2, 1.5, 0.01, 0.02, 0.03; sequence 9, from 1/1; packed by pymavlink
FRAME = bytes.fromhex("fd1c00000901011e000039300000cdcccc3dcdcc4cbe0000c03f0ad7233c0ad7a33c8fc2f53c0161")
ROS2_HEAD, ROS1_HEAD = "000100001ee7006be956c9330400000063616d00", "070000001ee7006be956c9330300000063616d"
ROS2_IMAGE = f"{ROS2_HEAD}1b000000726762383b206a70656720636f6d707265737365642062677238000004000000ffd8ff00"
ROS1_IMAGE = f"{ROS1_HEAD}1a000000726762383b206a70656720636f6d70726573736564206267723804000000ffd8ff00"
PARTS = "39300000cdcccc3dcdcc4cbe0000c03f0ad7233c0ad7a33c8fc2f53c0000000000000000"
ROS2_MAVLINK = f"{ROS2_HEAD}01fd1c00000901011e000000016100000400000000000000{PARTS}"
ROS1_MAVLINK = f"{ROS1_HEAD}01fd1c00000901011e000000016104000000{PARTS}"
LENS = "7b14ae47e17ab4bf7b14ae47e17a943ffca9f1d24d62403f613255302aa933bf0000000000000000"
MATRIX = "0000000000a4804000000000000000000000000000f8734000000000000000000000000000ac80400000000000706640" + "00" * 16
ONE = "000000000000f03f"
ROS2_CAMERA = f"{ROS2_HEAD}68010000800200000a000000706c756d625f626f6200000005000000000000 00{LENS}{MATRIX}{ONE}"
ROS1_CAMERA = f"{ROS1_HEAD}680100008002000009000000706c756d625f626f6205000000{LENS}{MATRIX}{ONE}"


def channel(encoding: str, schema: str = "", topic: str = "/t") -> Channel:
    return Channel(topic=topic, encoding=encoding, schema=schema)


def protobuf() -> bytes:
    stamp = Timestamp(seconds=STAMP_NS // 10**9, nanos=STAMP_NS % 10**9)
    return CompressedImage(timestamp=stamp, frame_id="cam", data=JPEG, format="jpeg").SerializeToString()


def json_image(stamp: object) -> bytes:
    return json.dumps({"timestamp": stamp, "data": base64.b64encode(JPEG).decode(), "format": "jpeg"}).encode()


PICTURES = {
    "protobuf": ("protobuf", "foxglove.CompressedImage", protobuf(), "jpeg"),
    "json": ("json", "foxglove.CompressedImage", json_image({"sec": 1795221278, "nsec": 868833001}), "jpeg"),
    "json, text": ("json", "foxglove.CompressedImage", json_image("2026-11-21T00:34:38.868833001Z"), "jpeg"),
    "ros2": ("cdr", "sensor_msgs/msg/CompressedImage", bytes.fromhex(ROS2_IMAGE), "rgb8; jpeg compressed bgr8"),
    "ros1": ("ros1", "sensor_msgs/CompressedImage", bytes.fromhex(ROS1_IMAGE), "rgb8; jpeg compressed bgr8"),
}


@pytest.mark.parametrize("way", PICTURES)
def test_a_compressed_image_has_its_stamp_to_the_nanosecond_and_its_bytes(way: str) -> None:
    encoding, schema, data, form = PICTURES[way]
    own = channel(encoding, schema)
    assert kind_of(own) is ChannelKind.IMAGES
    assert tuple(read_encoded_image(own, data)) == (STAMP_NS, JPEG, form)
    for size in range(len(data)):  # cut anywhere: refused, or without what comes last; nothing else is raised
        with suppress(ValueError):
            read_encoded_image(own, data[:size])


def test_a_jpeg_without_a_schema_is_one_too() -> None:
    assert tuple(read_encoded_image(channel("", ""), JPEG)) == (None, JPEG, "jpeg")


def mavlink_json(**changes: object) -> bytes:
    header = {"system_id": 1, "component_id": 1, "sequence": 9}
    angles = {"roll": 0.1, "pitch": -0.2, "yaw": 1.5, "rollspeed": 0.01, "pitchspeed": 0.02, "yawspeed": 0.03}
    message = {"type": "ATTITUDE", "time_boot_ms": 12345, **angles, **changes}
    return json.dumps({"header": header, "message": message}).encode()


FRAMES = {
    "raw": ("application/octet-stream", "", FRAME),
    "in a protobuf field": ("protobuf", "some.Bytes", b"\x0a\x08\x08\x9e\xce\x83\xd8\x06\x10\x01\x12\x28" + FRAME),
    "in an array": ("cdr", "std_msgs/msg/UInt8MultiArray", b"\0\1\0\0" + bytes(8) + b"\x28\0\0\0" + FRAME),
    "base64": ("json", "", json.dumps({"stamp": {"sec": 1}, "data": base64.b64encode(FRAME).decode()}).encode()),
    "a list": ("json", "", json.dumps({"bytes": list(FRAME)}).encode()),
    "ros2": ("cdr", "mavros_msgs/msg/Mavlink", bytes.fromhex(ROS2_MAVLINK)),
    "ros1": ("ros1", "mavros_msgs/Mavlink", bytes.fromhex(ROS1_MAVLINK)),
    "json fields": ("json", "mavlink.out", mavlink_json()),
}


@pytest.mark.parametrize("way", FRAMES)
def test_a_frame_is_the_bytes_that_were_sent_whatever_it_is_wrapped_in(way: str) -> None:
    encoding, schema, data = FRAMES[way]
    reader = FrameReader(channel(encoding, schema))
    assert [frame for _ in range(3) for frame in reader.frames(data)] == [FRAME] * 3
    assert reader.unreadable == 0


def test_a_message_id_of_four_bytes_is_no_frame() -> None:
    reader = FrameReader(channel("ros1", "mavros_msgs/Mavlink"))
    assert reader.frames(bytes.fromhex(ROS1_MAVLINK.replace("1e000000", "1e000001"))) == []
    assert reader.unreadable == 1


def test_frames_that_are_cut_over_messages_are_put_together() -> None:
    reader = FrameReader(channel("raw"))
    assert reader.frames(FRAME + FRAME[:11]) == [FRAME]
    assert reader.frames(FRAME[11:]) == [FRAME]


def test_fields_with_names_flags_arrays_and_nothing_are_packed_as_pymavlink_does() -> None:
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=154)
    link.seq = 9
    heartbeat = dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_QUADROTOR, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, 81, 4, dialect.MAV_STATE_ACTIVE, 3
    ).pack(link)
    link.seq = 9
    gimbal = dialect.MAVLink_gimbal_device_attitude_status_message(
        0, 0, 5, 44, [1.0, 0, 0, 0], math.nan, math.nan, math.nan, 0
    ).pack(link)
    header = {"system_id": 1, "component_id": 154, "sequence": 9}
    fields = {
        "type": "HEARTBEAT",
        "mavtype": {"type": "MAV_TYPE_QUADROTOR"},
        "autopilot": {"type": "MAV_AUTOPILOT_ARDUPILOTMEGA"},
        "base_mode": "MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | MAV_MODE_FLAG_STABILIZE_ENABLED"
        " | MAV_MODE_FLAG_CUSTOM_MODE_ENABLED",
        "custom_mode": 4,
        "system_status": {"type": "MAV_STATE_ACTIVE"},
        "mavlink_version": 3,
    }
    rates = dict.fromkeys(("angular_velocity_x", "angular_velocity_y", "angular_velocity_z"))  # null: not a number
    attitude = {"time_boot_ms": 5, "flags": {"bits": 44}, "q": [1, 0, 0, 0], **rates}
    quaternion = {"type": "GIMBAL_DEVICE_ATTITUDE_STATUS", **attitude}
    reader = FrameReader(channel("json", topic="mavlink/out"))
    got = [
        frame
        for message in (fields, quaternion, {"type": "NO_SUCH_MESSAGE"})
        for frame in reader.frames(json.dumps({"header": header, "message": message}).encode())
    ]
    assert [bytes(frame) for frame in got] == [bytes(heartbeat), bytes(gimbal)]
    assert reader.unreadable == 1


def in_big_endian(cdr: str) -> str:
    """ROS2_CAMERA as a machine of the other byte order writes it: stamp, name, size, model, doubles."""
    data, out, at = bytes.fromhex(cdr), bytearray(b"\0\0\0\0"), 4
    for count, size in ((3, 4), (4, 1), (3, 4), (12, 1), (1, 4), (4, 1), (len(data), 8)):
        for place in range(at, min(at + count * size, len(data)), size):
            out += data[place : place + size][::-1]
        at += count * size
    return out.hex()


# CDR 2 aligns doubles to four bytes: those of ROS2_CAMERA begin four earlier.
CDR2_CAMERA = "0007" + ROS2_CAMERA[4:].replace("05000000000000 00", "05000000").replace(" ", "")


@pytest.mark.parametrize(
    ("encoding", "schema", "data"),
    [
        ("cdr", "sensor_msgs/msg/CameraInfo", ROS2_CAMERA),
        ("cdr", "sensor_msgs/msg/CameraInfo", in_big_endian(ROS2_CAMERA)),
        ("cdr", "sensor_msgs/msg/CameraInfo", CDR2_CAMERA),
        ("ros1", "sensor_msgs/CameraInfo", ROS1_CAMERA),
    ],
    ids=["ros2", "big endian", "cdr 2", "ros1"],
)
def test_a_camera_has_its_size_focal_lengths_and_lens(encoding: str, schema: str, data: str) -> None:
    camera = read_camera(channel(encoding, schema), bytes.fromhex(data))
    assert (camera.width_px, camera.height_px) == (640, 360)
    assert (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px) == (532.5, 533.5, 319.5, 179.5)
    np.testing.assert_array_equal(camera.distortion, (-0.08, 0.02, 0.0005, -0.0003, 0.0))


def test_frames_are_told_from_messages_however_long_the_pieces_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("replay.foreign.messages._PIECE_BYTES", 64)
    messages = [FRAME + FRAME[:7], FRAME[7:], b"", b"\xfd" * 500, FRAME * 3]
    found = [
        (int(number), frame)
        for cut, numbers in FrameReader(channel("raw")).cuts(messages)
        for number, frame in zip(numbers, cut.each(), strict=True)
    ]
    assert found == [(0, FRAME), (1, FRAME), (4, FRAME), (4, FRAME), (4, FRAME)]


def test_a_message_of_megabytes_holds_no_frame() -> None:
    reader = FrameReader(channel("raw"))
    assert reader.frames(FRAME * ((5 << 20) // len(FRAME))) == []
    assert reader.unreadable == 1


@pytest.mark.parametrize("stamp", [{"sec": 2**62}, {"sec": 9_223_372_037}, {"sec": -5}])
def test_a_stamp_that_no_clock_says_is_none(stamp: dict[str, int]) -> None:
    data = json.dumps({"timestamp": stamp, "format": "jpeg", "data": ""}).encode()
    assert read_encoded_image(channel("json", "foxglove.CompressedImage"), data).stamp_ns is None


def claiming(field: str) -> tuple[Channel, bytes]:
    """A message of megabytes, little of which is an image or a camera."""
    header = b"\0\1\0\0" + bytes(8)
    match field:
        case "frame":
            text = header + (2 << 20).to_bytes(4, "little") + bytes(2 << 20)
            return channel("cdr", "sensor_msgs/msg/CompressedImage"), text + bytes(8)
        case "format":
            message = CompressedImage(format="x" * (2 << 20), data=b"\xff\xd8\xff")
            return channel("protobuf", "foxglove.CompressedImage"), message.SerializeToString()
        case "name":
            return channel("json", "foxglove.CompressedImage"), json.dumps({"format": "x" * 200, "data": ""}).encode()
        case _:
            sizes = bytes(4) + (480).to_bytes(4, "little") + (640).to_bytes(4, "little") + bytes(4)
            numbers = (1 << 18).to_bytes(4, "little") + bytes((1 << 21) + 200)
            return channel("cdr", "sensor_msgs/msg/CameraInfo"), header + sizes + numbers


@pytest.mark.parametrize(
    ("field", "said"),
    [("frame", "text of"), ("format", "more than an image"), ("name", "200 letters"), ("lens", "length 262144")],
)
def test_texts_and_numbers_of_megabytes_are_not_made_into_any(field: str, said: str) -> None:
    made, data = claiming(field)
    with pytest.raises(ValueError, match=said):
        (read_camera if field == "lens" else read_encoded_image)(made, data)
