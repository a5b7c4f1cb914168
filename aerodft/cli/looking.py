"""Who looks at a station's images, and what became of that."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from aerodft.adapters.config.station import StationConfig
from aerodft.model import PixelSource
from aerodft.service import ObserverCounts, ObserverSchedule, Pipeline


@dataclass(frozen=True, slots=True)
class ImageObservers:
    """All that looks at a station's images.

    Attributes:
        lookouts: What a feed shows images to.
        names: Of the tables that ask for each.
        notes: What some of them have to say of their own, by that name.
    """

    lookouts: tuple[ObserverSchedule, ...] = ()
    names: tuple[str, ...] = ()
    notes: Mapping[str, Callable[[], dict[str, object]]] = field(default_factory=dict)

    def report(self, counts: Sequence[ObserverCounts]) -> dict[str, object]:
        """What was looked at, for the summary; empty where nobody looked.

        Args:
            counts: Of each lookout.
        """
        looks: dict[str, object] = {}
        for name, count in zip(self.names, counts, strict=True):
            found = {"images": count.looked, "skipped": count.skipped, "unreadable": count.unreadable}
            looks[name] = found | (self.notes[name]() if name in self.notes else {})
        return looks


def build_observers(
    station: StationConfig, pipeline: Pipeline, where: object, *, may_record: bool = False
) -> ImageObservers:
    """Who looks at the images of a station.

    Args:
        station: The station.
        pipeline: Its pipeline, which knows about where the camera is.
        where: The configuration's name in messages.
        may_record: Images may come with a recording, whatever the configuration says of their source.

    Raises:
        ConfigError: There is something to look for, and no images.
        InputError: The reference image of a watched camera is of no use.
    """
    objects = station.objects is not None and station.objects.detect
    tracked = any(probe.source is PixelSource.TRACKED for probe in station.pipeline.probes)
    if not (station.watch or station.markers or objects or station.river or tracked):
        return ImageObservers()
    from aerodft.cli.lookouts import lookouts_of

    return lookouts_of(station, pipeline, where, may_record=may_record)
