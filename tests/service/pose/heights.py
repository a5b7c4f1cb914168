"""Heights at one stamp, under a vehicle whose attitude is a function of time."""

from dataclasses import dataclass

import numpy as np

from aerodft.service import LAST, HeightSettings
from aerodft.service.height_sources import HEIGHT_SOURCES
from aerodft.service.pose.heights import HeightSources
from aerodft.service.streams import Missing, Query


@dataclass(frozen=True)
class Height:
    """A height, and all that is said of it."""

    height_agl_m: float
    std_m: float
    source: str
    datum: str
    age_s: float
    foot_m: tuple[float, float] = (0.0, 0.0)
    reasons: tuple[str, ...] = ()


class Heights:
    """Sources of the height, asked as of the last tick.

    Args:
        tracks: What they say, by time since boot.
        settings: As ``HeightSettings``.
    """

    def __init__(self, *tracks, **settings):
        self.all = HeightSources(HeightSettings(**settings))
        self.append(*tracks)

    def append(self, *tracks):
        for track in tracks:
            self.all.append(track, track.boot_ns)

    def at(self, stamp_ns, watermark_ns, vehicle, place=(np.nan, np.nan)):
        """The height, or why there is none; the vehicle's attitude by its time, or why there is none of that."""
        asked = Query(np.array([stamp_ns]), LAST, np.array([watermark_ns]))
        batch = self.all.at(asked, _by_time(vehicle), np.array([place]))
        if batch.missing[0] != Missing.NOTHING:
            assert (batch.source.tolist(), batch.reasons) == ([-1], {})
            return Missing(batch.missing[0])
        source = batch.order[batch.source[0]]
        datum = HEIGHT_SOURCES[source].datum
        numbers = float(batch.height_agl_m[0]), float(batch.std_m[0])
        foot_m = tuple(batch.foot_m[0].tolist())
        return Height(*numbers, source, datum, float(batch.age_s[0]), foot_m, batch.reasons.get(0, ()))

    def switch(self, before, after, stamp_ns, vehicle):
        """That one source follows another."""
        return self.all.switch(before, after, stamp_ns, LAST, _by_time(vehicle))


def _by_time(vehicle):
    def vehicle_at(query):
        assert len(query.ticks) == len(query.watermark_ns) == len(query.stamps_ns)
        each = [vehicle(stamp_ns) if callable(vehicle) else vehicle for stamp_ns in query.stamps_ns.tolist()]
        missing = [value if isinstance(value, Missing) else Missing.NOTHING for value in each]
        wxyz = [np.full(4, np.nan) if isinstance(value, Missing) else value for value in each]
        return np.array(wxyz).reshape(-1, 4), np.array(missing, dtype=np.int64)

    return vehicle_at
