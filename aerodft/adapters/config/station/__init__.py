"""Station files: the telemetry, images, probes and outputs of one station."""

from aerodft.adapters.config.station.ground import COPY_NAME, copy_terrain, travels
from aerodft.adapters.config.station.loading import (
    load_station,
    parse_station,
    resolved_toml,
    with_calibration,
    with_derived_settings,
)
from aerodft.adapters.config.station.overrides import HOME_ABOVE_PLANE, NO_SETTINGS, Settings
from aerodft.adapters.config.station.probe_tables import river_probes
from aerodft.adapters.config.station.station_config import (
    Device,
    ImageInput,
    Rate,
    StationConfig,
    Stills,
    StreamInput,
    Topics,
    VideoFile,
    stated_start_ns,
)
