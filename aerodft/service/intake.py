"""Raw telemetry into poses: several ticks at once where that makes no difference to one after the other."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from aerodft.model.batch import Batch
from aerodft.model.telemetry import Track
from aerodft.service.clock_ticks import Ticks
from aerodft.service.feed import joined_blocks
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
        self._decoded = deque[tuple[Track, ...]]()  # of ticks to come

    @property
    def rejected(self) -> dict[str, int]:
        """Telemetry that held no value so far, by ``MESSAGE: reason``."""
        return dict(self._decoder.rejected)

    def take_together(self, batches: Sequence[Batch], stamps: Callable[[], Iterable[tuple[int, int]]]) -> bool:
        """Take in all batches, each then to be seen as if it had just come.

        Args:
            batches: Of consecutive ticks.
            stamps: What ``PoseSource.prepare`` takes, asked for when the clocks are known.

        Returns:
            False where they must be taken in one by one.
        """
        blocks = [block for batch in batches for block in batch.raw]
        senders = {(block.protocol, block.sender) for block in blocks}
        if len(batches) == 1 or len(senders) != 1 or not self._poses.is_settled:
            return False
        tracks = self._decoder.decode(joined_blocks(blocks))
        ticks_ns = np.array([batch.now_ns for batch in batches])
        if self._poses.append_ticks(tracks, ticks_ns):
            self._poses.prepare(stamps())
            return True
        self._decoded.extend(Ticks.of(tracks, ticks_ns).alone(tick) for tick in range(len(batches)))
        return False

    def take(self, batch: Batch) -> Iterator[int]:
        """Take in one batch; by how much UTC of this machine's stamps changes, for each of its blocks (ns)."""
        blocks = [self._decoded.popleft()] if self._decoded else map(self._decoder.decode, batch.raw)
        yield from map(self._poses.append, blocks)
