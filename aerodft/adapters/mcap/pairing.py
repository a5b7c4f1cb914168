"""Video packets get the arrival of the image that they became, by which the two find each other in a recording.

A packet comes straight from the stream, its image through the inbox, which says when it arrived; so the packet waits.
"""

from collections import deque
from dataclasses import replace

from aerodft.model.image import VideoPacket

_MOST_WAITING = 128  # packets: seconds of video, far longer than any image takes


class PacketPairing:
    """Holds packets until their image is there, or will not come."""

    def __init__(self) -> None:
        self._waiting: deque[VideoPacket] = deque()
        self._last_ns = 0

    def add(self, packet: VideoPacket) -> list[VideoPacket]:
        """Take a packet; returns one that has waited too long."""
        self._waiting.append(packet)
        return [self._timed(self._waiting.popleft())] if len(self._waiting) > _MOST_WAITING else []

    def arrived(self, index: int, arrival_ns: int) -> list[VideoPacket]:
        """The packets up to that of this image, in order; its own with the image's arrival."""
        done: list[VideoPacket] = []
        if any(packet.index == index for packet in self._waiting):
            while not done or done[-1].index != index:
                packet = self._waiting.popleft()
                done.append(self._timed(replace(packet, arrival_ns=arrival_ns) if packet.index == index else packet))
        return done

    def rest(self) -> list[VideoPacket]:
        """All that still waits."""
        done = [self._timed(packet) for packet in self._waiting]
        self._waiting.clear()
        return done

    def _timed(self, packet: VideoPacket) -> VideoPacket:
        """The packet, not before the one that was handed out last."""
        if packet.arrival_ns <= self._last_ns:
            packet = replace(packet, arrival_ns=self._last_ns + 1)
        self._last_ns = packet.arrival_ns
        return packet
