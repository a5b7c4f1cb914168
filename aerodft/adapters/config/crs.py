"""What a file may call its coordinates, beside the codes of maps."""

from typing import Final

LOCAL: Final = "local"
"""Metres east, north and up of somewhere."""

GEO: Final = "geo"
"""WGS84 degrees."""
