"""What running a station, importing and recomputing are assembled from, out of a station's configuration."""

from aerodft.app.assembly.pipeline import (
    ImageObservers,
    build_calibrator,
    build_observers,
    build_pipeline,
    build_recorder,
    closing_recorder,
    outputs_run,
    run,
)
from aerodft.app.assembly.run_result import MeasurementSink, RunResult, RunStatistics
from aerodft.app.assembly.sources import (
    DEFAULT_RATE_HZ,
    DelayedSource,
    RecordedRun,
    RecordedTelemetry,
    check_size,
    open_telemetry_log,
    recorded_station,
    reoffset,
    size_checked,
    station_of,
    stations_of,
)
