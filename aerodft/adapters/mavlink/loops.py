"""The loops over files' bytes: compiled where that is possible, else over whole arrays."""

from typing import Final

from aerodft.adapters.mavlink import (
    kernels,
    payloads,
    selection,
    vectorised,
    vectorised_selection,
    vectorised_tlog,
)
from aerodft.geometry.jit import COMPILES

scan_tlog: Final = kernels.scan_tlog if COMPILES else vectorised_tlog.scan_tlog
read_headers: Final = kernels.read_headers if COMPILES else vectorised.read_headers
gather: Final = payloads.gather if COMPILES else vectorised.gather
select: Final = selection.select if COMPILES else vectorised_selection.select
