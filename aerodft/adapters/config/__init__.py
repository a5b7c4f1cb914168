"""Configuration: TOML files with the unit in every key, to values in SI units."""

from aerodft.adapters.config.covariance import load_covariance
from aerodft.adapters.config.keys import Many, Pixel, Positive, Real, Text, impossible, matching
from aerodft.adapters.config.reading import validated
from aerodft.adapters.config.tables import GEO, LOCAL, Table
