"""What the pipeline asks of the world: Protocols of one to three methods, wired together in ``cli``."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Protocol, TypeVar, runtime_checkable

from aerodft.dft import MeasurementBatch, Setup
from aerodft.model import Arrival, Event, Image, IntArray, Observation, PoseBatch, PoseSample, RawBlock, Track
from aerodft.service.batches import Batches
from aerodft.service.outputs import Estimate

Known = TypeVar("Known")


class Clock(Protocol):
    """The only place where time is read: the wall's, or a virtual one in replay."""

    def now_ns(self) -> int:
        """Host UTC."""
        ...

    def sleep_until(self, when_ns: int) -> None:
        """Return at ``when_ns`` or later."""
        ...


class Source(Protocol):
    """Recorded input: a log, a video, a recording."""

    def events(self) -> Iterator[Event]:
        """All events, arrivals not decreasing."""
        ...


@runtime_checkable
class GatheredSource(Source, Protocol):
    """Recorded input that has many images at once, too."""

    def gathered(self) -> Iterator[Arrival]:
        """The same events, first arrivals not decreasing, images together where they can be."""
        ...


class Feed(Protocol):
    """Live or recorded input as batches of ticks: one, live, or many."""

    def batches(self) -> Iterator[Batches]:
        """Batches with increasing ticks, empty ones included where time alone matters, until the end."""
        ...


class TelemetryDecoder(Protocol):
    """Raw frames to tracks; stateful, and independent of how frames are cut into blocks."""

    @property
    def rejected(self) -> Mapping[str, int]:
        """Rows left out so far, by ``MESSAGE: reason``."""
        ...

    def decode(self, block: RawBlock) -> tuple[Track, ...]:
        """The tracks of this block's frames; unknown or damaged frames are counted, never raised."""
        ...


class Calibrator(Protocol[Known]):
    """Turns the telemetry's poses into better ones."""

    def known(self) -> Known:
        """What is known by now, and stays as it is whatever is learned after it."""
        ...

    def refine(self, poses: PoseBatch, known: Sequence[Known], which: IntArray) -> PoseBatch:
        """The poses corrected by ``which (n,)`` of what was known; anything not ok passes unchanged.

        With the calibration's covariance and id.
        """
        ...


class ImageObserver(Protocol):
    """Finds in images what probes, landmarks or a ``Calibrator`` want to know the pixels of."""

    def observe(self, image: Image) -> tuple[Observation, ...]:
        """What is seen in an image that has pixels, by its stamp, clock and index; called from one thread, in order.

        Raises:
            AerodftError: The pixels cannot be read.
        """
        ...


class LandmarkObserver(Protocol):
    """Learns from landmarks in the images, most likely for a ``Calibrator``."""

    def observes(self, name: str) -> bool:
        """Whether observations of this name are of a landmark."""
        ...

    def fits(self, observation: Observation) -> bool:
        """Whether an observation of such a name has as many pixels as it must."""
        ...

    def observe(self, sample: PoseSample, observations: tuple[Observation, ...]) -> Estimate:
        """Learn from what fits, seen at the stamp of the unrefined ``sample``."""
        ...


class ObjectTracker(Protocol):
    """Follows what moves from image to image, by its outlines."""

    def follow(
        self, setup: Setup, sample: PoseSample, observations: tuple[Observation, ...], image: int | None
    ) -> MeasurementBatch | None:
        """What is known of all objects after the next image, seen from ``sample``; None where that is nothing new."""
        ...
