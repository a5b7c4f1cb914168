"""MCAP files as other tools write them, from a log and pictures."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from aerodft.adapters.telemetry import TlogSource
from aerodft.model import RawBlock

LINK, PICTURES, CAMERA = "/drone/link", "/camera/image/compressed", "/camera/calibration"
Frames = Sequence[tuple[int, bytes]]
Packets = Sequence[tuple[int, bytes]]


def frames_of(log: Path) -> list[tuple[int, bytes]]:
    """Arrival and bytes of every frame of a .tlog."""
    blocks = [block for block in TlogSource(log).events() if isinstance(block, RawBlock)]
    return [
        (int(at_ns), block.data[start : start + size])
        for block in blocks
        for at_ns, start, size in zip(block.arrival_ns, block.offset, block.length, strict=True)
    ]


def jpegs(stamps_ns: Sequence[int], width_px: int, height_px: int) -> list[tuple[int, bytes]]:
    """A grey image at each stamp."""
    data = cv2.imencode(".jpg", np.full((height_px, width_px, 3), 90, np.uint8))[1].tobytes()
    return [(stamp_ns, data) for stamp_ns in stamps_ns]


def write_foreign(  # noqa: PLR0913 - each of them is another tool
    path: Path,
    frames: Frames,
    pictures: Packets = (),
    *,
    form: str = "jpeg",
    topic: str = LINK,
    calibration: CameraCalibration | None = None,
    apart: bool = False,
    compressed: bool = True,
) -> Path:
    """Write one file: raw frames, and pictures in Foxglove's protobuf, 5 ms after their stamps.

    Args:
        path: The file.
        frames: Log time and bytes.
        pictures: Stamp and bytes.
        form: Of the pictures: ``jpeg``, ``h264``.
        topic: Of the frames.
        calibration: Of the camera.
        compressed: By lz4; else not, without checksums.
        apart: One topic after the other, as converters do, not in order of time.
    """
    schema = CompressedVideo if form == "h264" else CompressedImage
    with path.open("wb") as file:
        compression = CompressionType.LZ4 if compressed else CompressionType.NONE
        writer = Writer(file, compression=compression, chunk_size=1 << 13, enable_crcs=compressed)
        writer.start(library="another tool")

        def add(name: str, message: type) -> int:
            text = build_file_descriptor_set(message).SerializeToString()
            return writer.register_schema(f"foxglove.{name}", "protobuf", text)

        link = writer.register_channel(topic, "application/octet-stream", 0)
        items = [(at_ns, link, data) for at_ns, data in frames]
        if pictures:
            images = writer.register_channel(PICTURES, "protobuf", add(schema.DESCRIPTOR.name, schema))
            for stamp_ns, data in pictures:
                stamp = Timestamp(seconds=stamp_ns // 10**9, nanos=stamp_ns % 10**9)
                message = schema(timestamp=stamp, frame_id="camera", data=data, format=form)
                items.append((stamp_ns + 5_000_000, images, message.SerializeToString()))
        if calibration is not None:
            camera = writer.register_channel(CAMERA, "protobuf", add("CameraCalibration", CameraCalibration))
            items.append((items[0][0], camera, calibration.SerializeToString()))
        for at_ns, channel, data in items if apart else sorted(items, key=lambda item: item[0]):
            writer.add_message(channel, at_ns, data, at_ns)
        writer.finish()
    return path
