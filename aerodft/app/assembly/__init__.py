"""What running a station, importing and recomputing are assembled from, out of a station's configuration."""

from aerodft.app.assembly.image_observers import ImageObservers, build_observers
from aerodft.app.assembly.pipeline import build_pipeline, build_recorder, closing_recorder, outputs_run, run
from aerodft.app.assembly.recorded import (
    RecordedRun,
    RecordedTelemetry,
    open_telemetry_log,
    recorded_station,
    stations_of,
)
from aerodft.app.assembly.run_result import MeasurementSink, RunResult, RunStatistics
from aerodft.app.assembly.sources import DEFAULT_RATE_HZ, DelayedSource, check_size, reoffset, size_checked
