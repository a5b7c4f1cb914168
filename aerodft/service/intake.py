"""Raw telemetry into poses: several ticks at once where that makes no difference to one after the other."""

from collections.abc import Iterator
from typing import Final

from aerodft.model.batch import Batch
from aerodft.service.batches import Batches
from aerodft.service.clock_ticks import Ticks
from aerodft.service.ports import TelemetryDecoder
from aerodft.service.poses import PoseSource

FEWEST_TOGETHER: Final = 10
"""Ticks that are worth it; so many are taken in one by one before it is tried again."""


class Intake:
    """Decodes batches, and hands their tracks to the poses.

    Args:
        decoder: Turns raw telemetry into tracks.
        poses: Where they go.
    """

    def __init__(self, decoder: TelemetryDecoder, poses: PoseSource) -> None:
        self._decoder = decoder
        self._poses = poses
        self._ahead = Ticks((), (), 0)  # decoded
        self._next = 0  # the first of these that is yet to be taken in

    @property
    def rejected(self) -> dict[str, int]:
        """Telemetry that held no value so far, by ``MESSAGE: reason``."""
        return dict(self._decoder.rejected)

    def take_together(self, batches: Batches) -> int:
        """Take in the first batches, as many as can be, each then to be seen as if it had just come.

        Args:
            batches: Of consecutive ticks.

        Returns:
            How many were taken in; 0 where some must be taken in one by one.
        """
        count = len(batches)
        fewest = max(2, min(count, FEWEST_TOGETHER))
        while count >= fewest and self._poses.is_settled and self._decode(batches):
            ticks = self._ahead.between(self._next, self._next + count)
            if self._poses.append_ticks(ticks.tracks, batches.now_ns[:count]):
                self._next += count
                return count
            count //= 2
        return 0

    def take(self, batch: Batch) -> Iterator[int]:
        """Take in one batch; by how much UTC of this machine's stamps changes, for each of its blocks (ns)."""
        if self._next < self._ahead.count:
            self._next += 1
            yield self._poses.append(self._ahead.between(self._next - 1, self._next).tracks)
        else:
            yield from map(self._poses.append, map(self._decoder.decode, batch.raw))

    def _decode(self, batches: Batches) -> bool:
        """Have the tracks of all batches; False where several senders speak in them, or none."""
        if self._next < self._ahead.count:
            return True
        if len(batches.raw) != 1:
            return False
        tracks = self._decoder.decode(batches.raw[0])
        self._ahead, self._next = Ticks.of(tracks, batches.now_ns), 0
        return True
