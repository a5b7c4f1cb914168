"""``transects.csv`` of ``aerodft river``: the same columns for one image and for many."""

import csv
import io
from collections.abc import Iterator
from typing import Any, Final

from aerodft.cli.river_document import SIDES

COLUMNS: Final = (
    "station_m", "status", "width_m", "std_m", "ci95_low_m", "ci95_high_m", "bound",
    "wetted_m", "wetted_std_m", "channels", "images", "scatter_m",
    "left_lat", "left_lon", "right_lat", "right_lon",
    "left_u", "left_v", "right_u", "right_v", "left_std_px", "right_std_px",
)  # fmt: skip
"""Empty where not known: pixels are of one image, scatter is of several, places are of a known station."""


def table(document: dict[str, Any]) -> str:
    """A row for each transect of a document."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(dict(_cells(each)) for each in document["transects"])
    return text.getvalue()


def _cells(transect: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    low, high = transect["ci95"] or (None, None)
    named = {"std_m": transect["std"], "ci95_low_m": low, "ci95_high_m": high, "wetted_std_m": transect["wetted_std"]}
    yield from ((name, transect.get(name)) for name in COLUMNS[:12] if name not in named)
    yield from named.items()
    for row, side in enumerate(SIDES):
        place = transect["geo"][row] if transect["geo"] else {"lat": None, "lon": None}
        u, v = transect[side] or (None, None)
        yield from ((f"{side}_lat", place["lat"]), (f"{side}_lon", place["lon"]))
        yield from ((f"{side}_u", u), (f"{side}_v", v), (f"{side}_std_px", transect["bank_std_px"][row]))
