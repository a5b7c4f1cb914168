"""Configuration: TOML files with the unit in every key, to values in SI units."""

from aerodft.adapters.config.covariance import load_covariance
from aerodft.adapters.config.reading import validated
from aerodft.adapters.config.tables import (
    GEO,
    LOCAL,
    Many,
    Pixel,
    Positive,
    Real,
    Table,
    Text,
    impossible,
    matching,
)
