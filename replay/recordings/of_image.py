"""What a recording holds of one image: its pose, and what was measured in it."""

from collections.abc import Iterator
from typing import Final

from aerodft.adapters.recording.read import ReadMessage
from aerodft.adapters.recording.write import image_sequence
from aerodft.adapters.wire.pose import POSE_SCHEMA, decode_pose
from aerodft.conventions import SECOND_NS
from aerodft.errors import located
from aerodft.model import Image, PoseSample, StampClock
from replay.recordings.recording import Recording

_LATEST_NS: Final = 30 * SECOND_NS
"""A pose is recorded at most so long after its image came: longer than any station waits for telemetry."""

_USUAL_NS: Final = 3 * SECOND_NS
"""What is measured in an image is recorded so soon, but for what waits longest for telemetry."""


def pose_of(recording: Recording, image: Image) -> PoseSample | None:
    """The pose of a recorded image; None where none was recorded.

    Raises:
        InputError: It is damaged.
    """
    from_ns, sequence = image.arrival_ns, image_sequence(image.index)
    for message in _poses(recording, from_ns, from_ns + _LATEST_NS):
        if message.sequence == sequence:
            with located(recording.folder):
                sample = decode_pose(message.data)
            if image.clock is not StampClock.UTC or sample.stamp_ns == image.stamp_ns:
                return sample
    return None


def pose_at(recording: Recording, stamp_ns: int) -> PoseSample | None:
    """The pose that was recorded with a stamp (UTC); None where there is none.

    Raises:
        InputError: It is damaged.
    """
    stamp = f'"{stamp_ns}"'.encode()
    for message in _poses(recording, None, None):
        if stamp in message.data:
            with located(recording.folder):
                sample = decode_pose(message.data)
            if sample.stamp_ns == stamp_ns:
                return sample
    return None


def measurements_of(recording: Recording, image: Image) -> Iterator[bytes]:
    """The recorded measurements of an image, as ``aerodft.measurement/1``, those of a probe that came later too.

    Raises:
        InputError: One is damaged.
    """
    from_ns, own = image.arrival_ns, b'"image":%d,' % image.index
    for payload in recording.measurements(from_ns=from_ns, to_ns=from_ns + _USUAL_NS):
        if own in payload:
            yield payload


def _poses(recording: Recording, from_ns: int | None, to_ns: int | None) -> Iterator[ReadMessage]:
    return recording.messages(from_ns=from_ns, to_ns=to_ns, wanted=lambda channel: channel.schema == POSE_SCHEMA)
