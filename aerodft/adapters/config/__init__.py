"""Configuration: TOML files with the unit in every key, to values in SI units."""
