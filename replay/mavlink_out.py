"""Recorded MAVLink on a link again, for a ground station: the frames as they were, not one byte changed."""

from aerodft.adapters.foreign.frames import FrameReader
from aerodft.adapters.mavlink.layout import V1, V2
from aerodft.adapters.mavlink.transport import Transport
from aerodft.adapters.mcap.channels import Channel
from aerodft.errors import NoAnswerError
from aerodft.model.telemetry import WireProtocol
from replay.recording import Recording
from replay.segments import channels_of
from replay.timeline import AnyRecording, Item, name_of


def holds_mavlink(recording: AnyRecording, channel: Channel) -> bool:
    """Whether a channel of a recording has MAVLink frames."""
    if isinstance(recording, Recording):
        return channel.encoding == WireProtocol.MAVLINK
    return channel.topic in recording.mavlink


def check_mavlink(recordings: tuple[AnyRecording, ...]) -> None:
    """Refuse recordings of which none has MAVLink.

    Raises:
        NoAnswerError: None has.
    """
    for each in recordings:
        segments = each.data if isinstance(each, Recording) else each.segments
        if any(holds_mavlink(each, channel) for one in segments for channel in channels_of(one).values()):
            return
    raise NoAnswerError(
        "no MAVLink to send", where=name_of(recordings[0]), expected="a recording with raw MAVLink frames"
    )


class MavlinkOut:
    """Sends frames; an outlet of the player.

    Attributes:
        frames: Sent so far.

    Args:
        transport: Where to.
    """

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self._readers: dict[tuple[int, str], FrameReader] = {}
        self.frames = 0

    def send(self, item: Item, shift_ns: int) -> None:  # noqa: ARG002 - frames are never changed
        """Send the frames of a message, where it has any."""
        if not holds_mavlink(item.recording, item.message.channel):
            return
        for frame in self._frames(item):
            self._transport.write(frame)
            self.frames += 1

    def _frames(self, item: Item) -> list[bytes]:
        data, channel = item.message.data, item.message.channel
        if isinstance(item.recording, Recording) or data[:1] in {bytes([V1]), bytes([V2])}:
            return [data]
        key = (id(item.recording), channel.topic)
        reader = self._readers.get(key)
        if reader is None:
            reader = self._readers[key] = FrameReader(channel)
        return reader.frames(data)
