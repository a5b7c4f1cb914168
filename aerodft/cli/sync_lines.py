"""What an alignment makes of a station, in the digits that are written: ``sync`` prints it, ``import`` uses it."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import tomli_w

from aerodft.adapters.config.inputs import VideoFile
from aerodft.adapters.config.station import StationConfig
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.cli.sync_run import SyncRun
from aerodft.conventions import SECOND_NS
from aerodft.service.settings import TelemetrySettings


@dataclass(frozen=True, slots=True, kw_only=True)
class SyncLines:
    """The settings of one alignment, rounded as they are written.

    Attributes:
        video: The video.
        start_ns: The stamp of its first image before anything is added: the offset belongs to it.
        time_offset_s: Added to a stamp at the reference.
        time_drift: Added to it per second since then.
        time_reference_ns: The reference, by the video's clock.
        time_std_s: Standard deviation of the aligned stamps, at worst over the video.
        delay_s: The gimbal's lag.
        lag_s: By how much more it may be late; None where the data do not tell.
    """

    video: Path
    start_ns: int
    time_offset_s: float
    time_drift: float
    time_reference_ns: int
    time_std_s: float
    delay_s: float
    lag_s: float | None

    @classmethod
    def of(cls, run: SyncRun, stated_std_s: float = 0.0) -> "SyncLines":
        """Those of an alignment.

        Args:
            run: The alignment.
            stated_std_s: What the station says of its stamps already; it stays.
        """
        found = run.alignment
        worst_s = max(found.attitude_std_s(run.seconds / 2), found.attitude_std_s(-run.seconds / 2))
        return cls(
            video=run.video.absolute(),
            start_ns=run.start_ns,
            time_offset_s=round(found.offset_s, 6),
            time_drift=round(found.drift, 8),
            time_reference_ns=found.reference_ns,
            time_std_s=math.ceil(math.hypot(stated_std_s, worst_s) * 1e4) / 1e4,
            delay_s=round(max(found.lag_s, 0.0), 4),
            lag_s=round(found.lateness_s, 4) if found.lag_told else None,
        )

    def text(self) -> str:
        """Lines of a station's file; with them its measurements are those of ``import --sync auto``."""
        images = {
            "video": str(self.video),
            "start": unix_ns_to_iso(self.start_ns),
            "time_offset_s": self.time_offset_s,
            "time_drift": self.time_drift,
            "time_reference": unix_ns_to_iso(self.time_reference_ns),
            "time_std_s": self.time_std_s,
        }
        attitude = {"delay_s": self.delay_s} | ({} if self.lag_s is None else {"lag_s": self.lag_s})
        return tomli_w.dumps({"images": images, "telemetry": {"attitude": attitude}})

    def applied(self, station: StationConfig, telemetry: TelemetrySettings) -> StationConfig:
        """The station as if its file had these lines."""
        attitude = replace(telemetry.attitude, delay_ns=round(self.delay_s * SECOND_NS))
        if self.lag_s is not None:
            attitude = replace(attitude, lag_ns=round(self.lag_s * SECOND_NS))
        images = replace(
            station.images,
            source=VideoFile(path=self.video, start_ns=self.start_ns),
            time_offset_s=self.time_offset_s,
            time_drift=self.time_drift,
            time_reference_ns=self.time_reference_ns,
            is_auto=False,
        )
        telemetry = replace(telemetry, attitude=attitude)
        pipeline = replace(station.pipeline, telemetry=telemetry, time_std_s=self.time_std_s)
        return replace(station, images=images, pipeline=pipeline)
