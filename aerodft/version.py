"""The version, as it stands in everything that is written."""

from typing import Final

VERSION: Final = "0.1.0"
SOFTWARE: Final = f"aerodft {VERSION}"
