"""What running a station, importing and recomputing are assembled from, out of a station's configuration."""

from aerodft.app.assembly.image_observers import ImageObservers, build_observers
from aerodft.app.assembly.pipeline import (
    DelayedSource,
    SizeChecked,
    build_pipeline,
    build_recorder,
    check_size,
    closing_recorder,
    outputs_run,
    run,
)
from aerodft.app.assembly.recorded import recorded_station, reoffset, stations_of
from aerodft.app.assembly.run_statistics import RunStatistics
from aerodft.app.assembly.signing import opened_signing
from aerodft.app.assembly.telemetry_log import open_telemetry_log
