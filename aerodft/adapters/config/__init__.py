"""Configuration: TOML files with the unit in every key, to values in SI units."""

from aerodft.adapters.config.covariance import load_covariance
from aerodft.adapters.config.keys import (
    TILT_RANGE,
    Elevations,
    ElevationStds,
    End,
    Many,
    Pixel,
    Positive,
    Real,
    Text,
    impossible,
    matching,
    pitch_hint,
)
from aerodft.adapters.config.reading import validated
from aerodft.adapters.config.tables import GEO, LOCAL, Table
