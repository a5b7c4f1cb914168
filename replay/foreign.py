"""Recordings by their path: aerodft's own, and other tools' (any MCAP file with MAVLink in it, and images)."""

import logging
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Final

from aerodft.adapters.codec.wire import LATEST_NS
from aerodft.adapters.config.inputs import Topics
from aerodft.adapters.foreign.pictures import read_camera
from aerodft.adapters.mcap.places import ReadChannel
from aerodft.adapters.mcap.reading import ReadMessage
from aerodft.adapters.mcap.scanning import scan_segment
from aerodft.errors import InputError, NoAnswerError
from aerodft.model.camera import Camera
from replay.recording import Recording
from replay.segments import channels_of, is_mcap, messages_of, numbered
from replay.topics import Roles, described, framed_of, roles_of, telemetry_of

_log = logging.getLogger(__name__)


class ForeignRecording:
    """Another tool's recording, open for reading; holds no file open.

    Attributes:
        path: The file, or the folder of files.
        segments: Its files.
        channels: By topic.
        roles: What each topic is, telemetry aside.
        start_ns: Earliest log time.
        end_ns: Latest log time.

    Args:
        path: An MCAP file, or a folder of them.
        topics: What is known of its topics beforehand.

    Raises:
        InputError: There is none, it cannot be read, or it is not clear which topic has the images.
        NoAnswerError: It holds no message.
    """

    def __init__(self, path: Path, topics: Topics | None = None) -> None:
        self.path = path
        self.segments = tuple(map(scan_segment, mcap_files(path)))
        chunks = [chunk for segment in self.segments for chunk in segment.chunks]
        if not chunks:
            raise NoAnswerError("the recording holds no message", where=path)
        if not all(segment.is_whole for segment in self.segments):
            _log.warning("%s: was not finished; read as far as it is whole", path)
        self.start_ns = min(chunk.start_ns for chunk in chunks)
        self.end_ns = max(chunk.end_ns for chunk in chunks)
        self.channels = {channel.topic: channel for each in self.segments for channel in channels_of(each).values()}
        self._stated = topics or Topics()
        self.roles: Roles = roles_of(path, self.segments, self._stated)

    @cached_property
    def framed(self) -> tuple[str, ...]:
        """Topics with MAVLink; found when somebody asks, since messages may have to be looked through."""
        return self._stated.mavlink or framed_of(self.path, self.segments)

    @cached_property
    def mavlink(self) -> tuple[str, ...]:
        """Topics of the vehicle's telemetry.

        Raises:
            InputError: It is not clear which they are.
        """
        return self._stated.mavlink or telemetry_of(self.path, self.channels, self.framed)

    def messages(
        self, topic: str | None = None, *, from_ns: int | None = None, to_ns: int | None = None
    ) -> Iterator[ReadMessage]:
        """Messages as they were written, log times in ``[from_ns, to_ns)``; None for all topics."""

        def wanted(channel: ReadChannel) -> bool:
            return topic is None or channel.topic == topic

        messages = messages_of(self.segments, from_ns=from_ns, to_ns=to_ns, wanted=wanted)
        return filter(lambda message: message.log_ns <= LATEST_NS, messages)  # beyond it is damage

    def refusal_without(self, what: str) -> InputError:
        """The refusal of a recording that lacks a channel of some kind."""
        return InputError(
            f"no {what} in the recording",
            where=self.path,
            got=described(self.channels),
            expected=f"a topic with {what}",
            hint="--topic says which topic is what",
        )

    def camera(self) -> Camera | None:
        """The camera that was recorded with the images; None where there is none.

        Raises:
            InputError: It is damaged, or of a lens model that is not known.
        """
        if self.roles.camera is None:
            return None
        message = next(self.messages(self.roles.camera), None)
        if message is None:
            return None
        try:
            return read_camera(message.channel, message.data)
        except ValueError as error:
            raise InputError(
                "the camera cannot be read", where=f"{self.path}, {message.channel.topic}", got=error
            ) from error


def mcap_files(path: Path) -> list[Path]:
    """The MCAP files that a path means, in order.

    Raises:
        InputError: There is none.
    """
    if path.is_file():
        return [path]
    paths = sorted(path.glob("*.mcap"), key=numbered) if path.is_dir() else []
    if not paths:
        got = "a folder without any" if path.is_dir() else "nothing"
        raise InputError("there is no recording", where=path, got=got, expected="an MCAP file, or a folder of them")
    return paths


OWN_SCHEMAS: Final = "aerodft."


def is_foreign(path: Path) -> bool:
    """Whether another tool's recording is there, rather than a folder that aerodft wrote.

    Raises:
        InputError: A file cannot be read.
    """
    if path.is_dir():
        return is_mcap(path) and next(path.glob("data_*.mcap"), None) is None
    return is_mcap(path) and not _is_own(path)


def open_recording(path: Path, topics: Topics | None = None) -> Recording | ForeignRecording:
    """Open whatever recording is there.

    Args:
        path: A recording's folder, an MCAP file, or a folder of MCAP files.
        topics: What is known of another tool's topics.

    Raises:
        InputError: There is none, or it cannot be read.
        NoAnswerError: It holds nothing.
    """
    return ForeignRecording(path, topics) if is_foreign(path) else Recording(path)


def _is_own(path: Path) -> bool:
    segment = scan_segment(path)
    segment.left_out.update(chunk.offset for chunk in segment.chunks)  # whoever reads on says what is damaged
    channels = channels_of(segment).values()
    return any(channel.schema.startswith(OWN_SCHEMAS) for channel in channels)
