"""What became of all that was offered to a recorder."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingTotals:
    """What became of all that was offered to a recorder: ``offered = stored + shed + lost``, of both kinds.

    Attributes:
        folder: Where the recording is.
        offered: Messages of the data files: what came, and the recorder's own status.
        messages: Stored.
        shed_messages: Not taken, because the disk was too slow.
        lost_messages: Not written, because it failed or was full.
        offered_images: Images that were due by the rate.
        images: Stored.
        shed_images: Not taken, because encoder or disk were too slow.
        lost_images: Not written, because the disk failed or was full, or because they could not be encoded.
    """

    folder: Path
    offered: int
    messages: int
    shed_messages: int
    lost_messages: int
    offered_images: int
    images: int
    shed_images: int
    lost_images: int

    @property
    def lost(self) -> int:
        """What a failing disk cost, messages and images."""
        return self.lost_messages + self.lost_images

    @property
    def counts(self) -> dict[str, int]:
        """The totals by name, as the station's status has them; what waits is not in a file yet, or not counted."""
        messages, images = self.shed_messages + self.lost_messages, self.shed_images + self.lost_images
        return {
            "offered_messages": self.offered,
            "recorded_messages": self.messages,
            "shed_messages": self.shed_messages,
            "lost_messages": self.lost_messages,
            "waiting_messages": self.offered - self.messages - messages,
            "offered_images": self.offered_images,
            "recorded_images": self.images,
            "shed_images": self.shed_images,
            "lost_images": self.lost_images,
            "waiting_images": self.offered_images - self.images - images,
        }
