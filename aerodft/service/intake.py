"""Raw telemetry into poses, in steps of as many ticks as can be taken in at once."""

from aerodft.service.batches import Batches
from aerodft.service.clock_ticks import Ticks
from aerodft.service.ports import TelemetryDecoder
from aerodft.service.poses import PoseSource


class Intake:
    """Decodes batches, and hands their tracks to the poses.

    Args:
        decoder: Turns raw telemetry into tracks.
        poses: Where they go.
    """

    def __init__(self, decoder: TelemetryDecoder, poses: PoseSource) -> None:
        self._decoder = decoder
        self._poses = poses
        self._decoded = Ticks((), (), 0)  # of the batches that are being taken in
        self._first = 0  # the first of these ticks that is yet to be taken in
        self._most = 1  # ticks that are tried at once: twice as many as went well last

    @property
    def rejected(self) -> dict[str, int]:
        """Telemetry that held no value so far, by ``MESSAGE: reason``."""
        return dict(self._decoder.rejected)

    def take(self, batches: Batches) -> tuple[int, int]:
        """Take in the telemetry of the first ticks, as of which the poses can then be asked.

        Args:
            batches: What is left of the ticks that are being taken in; all of them at first.

        Returns:
            Of how many ticks, and by how much UTC that was made of this machine's stamps before has changed (ns).
        """
        if self._first == self._decoded.count:
            if len(batches.raw) > 1:  # senders whose frames take turns
                return 1, self._take_senders(batches[:1])
            tracks = tuple(track for block in batches.raw for track in self._decoder.decode(block))
            self._decoded, self._first = Ticks.of(tracks, batches.now_ns), 0
        count = min(self._most, self._decoded.count - self._first) if self._poses.clock.is_settled else 1
        while True:
            shift_ns = self._poses.append(self._decoded.between(self._first, self._first + count))
            if shift_ns is not None:
                self._first += count
                self._most = 2 * count
                return count, shift_ns
            count //= 2

    def _take_senders(self, batches: Batches) -> int:
        """Take in a tick, sender by sender."""
        senders = [self._decoder.decode(block) for block in batches.raw] or [()]
        return sum(self._poses.append(Ticks.one(tracks)) or 0 for tracks in senders)
