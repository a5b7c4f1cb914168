"""What the pipeline has yet to answer, and the images that observations may still refer to."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from aerodft.model.arrays import IntArray
from aerodft.model.image import Image, StampClock
from aerodft.model.image_rows import ImageRows
from aerodft.model.observation import Observation
from aerodft.model.pose_columns import Posed

_REMEMBERED: Final = 512  # an observation comes at most this many images after its own


class Job(NamedTuple):
    """An image or an observation that waits for its telemetry.

    Attributes:
        stamp_ns: UTC, as far as it is known.
        deadline_ns: Tick on which it is answered with what there is.
        subject: With that stamp.
        clock: Whose stamp it came with.
        is_landmark: Whether it is learned from, not answered.
        is_object: Whether it is followed, not answered.
    """

    stamp_ns: int
    deadline_ns: int
    subject: Image | Observation
    clock: StampClock
    is_landmark: bool = False
    is_object: bool = False

    def shifted(self, by_ns: int) -> "Job":
        """The same where UTC of this machine's stamps has changed."""
        if self.clock is StampClock.UTC:
            return self
        stamp_ns = self.stamp_ns + by_ns
        return self._replace(stamp_ns=stamp_ns, subject=replace(self.subject, stamp_ns=stamp_ns))


class Ready(NamedTuple):
    """A job with its pose as the telemetry has it."""

    job: Job
    posed: Posed


@dataclass(frozen=True, slots=True)
class _Known:
    index: int
    stamp_ns: int
    clock: StampClock


class ImageMemory:
    """The stamps (UTC) of the newest images."""

    def __init__(self) -> None:
        self._known: deque[_Known] = deque(maxlen=_REMEMBERED)

    @property
    def last_ns(self) -> int | None:
        """Stamp of the last image; None before the first."""
        return self._known[-1].stamp_ns if self._known else None

    def are_behind(self, job: Job, tolerance_ns: int) -> bool:
        """Whether a job is an observation that was faster than the image that it was made in."""
        if isinstance(job.subject, Image) or self.last_ns is None or job.subject.image is not None:
            return False
        return self.last_ns < job.stamp_ns - tolerance_ns

    def add(self, index: int, stamp_ns: int, clock: StampClock) -> None:
        """Remember an image that came with a stamp of that clock."""
        self._known.append(_Known(index, stamp_ns, clock))

    def add_all(self, images: Sequence[Image], stamps_ns: IntArray) -> None:
        """Remember images with their stamps in UTC ``(n,)``, as far as they have pixels."""
        if isinstance(images, ImageRows):  # all of them have pixels, or none
            first = len(images) if images.width_px is None else -_REMEMBERED
            images, stamps_ns = images[first:], stamps_ns[first:]
        stamped = zip(images, stamps_ns.tolist(), strict=True)
        known = [(image.index, stamp_ns, image.clock) for image, stamp_ns in stamped if image.width_px is not None]
        for each in known[-_REMEMBERED:]:
            self.add(*each)

    def shift(self, by_ns: int) -> None:
        """UTC of this machine's stamps has changed."""
        for k, known in enumerate(self._known):
            if known.clock is not StampClock.UTC:
                self._known[k] = replace(known, stamp_ns=known.stamp_ns + by_ns)

    def stamp_ns(self, index: int) -> int | None:
        """Stamp of the image with this number; None where it is not remembered."""
        return next((known.stamp_ns for known in reversed(self._known) if known.index == index), None)

    def nearest(self, stamp_ns: int, tolerance_ns: int) -> int | None:
        """Number of the image taken closest to a stamp; None where none is close."""
        near = min(self._known, key=lambda known: abs(known.stamp_ns - stamp_ns), default=None)
        return near.index if near is not None and abs(near.stamp_ns - stamp_ns) <= tolerance_ns else None
