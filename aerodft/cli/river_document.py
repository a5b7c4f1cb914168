"""What ``aerodft river`` found, as its JSON document."""

import math
from collections.abc import Iterable
from typing import Any, Final

import numpy as np

from aerodft.dft.river_widths import RiverWidths
from aerodft.geometry.geodesy import lat_lon
from aerodft.model.arrays import BoolArray, FloatArray
from aerodft.model.pose import PoseSample
from aerodft.vision.bank_view import ONE_SIDED, hidden_per_metre
from aerodft.vision.river import WHY, NoRiver, River, RiverStatus

SCHEMA: Final = "aerodft.river/1"
_DOUBT: Final = 0.1  # of the outline, from which that is said
_TELLS: Final = 2.0  # standard deviations between an outline's two sides, from which they are told apart


def refusal_document(found: NoRiver) -> dict[str, Any]:
    """The document of an image without an answer."""
    return river_frame(found.status, [found.reason], 0.0)


def river_document(found: River, sample: PoseSample) -> dict[str, Any]:
    """The document of a river.

    Args:
        found: The river.
        sample: The pose that it was seen from.
    """
    used = np.array([found.status[row] is RiverStatus.OK for row in found.rows], dtype=bool)
    status, reasons = RiverStatus.OK, list(sample.reasons)
    if not used.any():
        first = found.status[int(found.rows[0])]
        status, reasons = first, [*reasons, WHY[first]]
    clear = float(np.mean(found.water.contrast > _TELLS))
    document = river_frame(status, reasons, clear * (1.0 - found.water.doubtful))
    if found.water.doubtful > _DOUBT:
        reasons.append(
            f"along {100 * found.water.doubtful:.0f} % of the outline there is a second clear edge inside: bare ground"
            " may have been taken for water, or water of two colours is there; look at the plate"
        )
    document["banks"] = {side: _polyline(found.edges.pixels_px[:, index]) for index, side in enumerate(_SIDES)}
    document["transects"] = list(_transects(found, sample))
    behind = sum(each["bound"] is not None for each in document["transects"])
    if behind:
        reasons.append(
            f"{behind} transects look over their near bank: each metre of growth on it hides {ONE_SIDED:g} m of water"
            " or more (hidden_m_per_m), their widths are bounds from below"
        )
    if used.any():
        document["width_m"] = width_summary(found.widths, used)
    return document


def width_summary(widths: RiverWidths, used: BoolArray) -> dict[str, Any]:
    """The used widths, at least one, in a few numbers."""
    median, std, ci95 = widths.median(used)
    known = widths.width_m[used]
    return {
        "median": median,
        "std": std,
        "ci95": list(ci95),
        "min": float(known.min()),
        "max": float(known.max()),
        "transects": int(used.sum()),
    }


_SIDES: Final = ("left", "right")


def river_frame(status: RiverStatus, reasons: list[str], confidence: float) -> dict[str, Any]:
    """A document without an answer yet."""
    return {
        "schema": SCHEMA,
        "status": str(status),
        "reasons": reasons,
        "banks": {side: [] for side in _SIDES},
        "transects": [],
        "width_m": None,
        "confidence": confidence,
        "files": [],
    }


def _polyline(pixels: FloatArray) -> list[list[float]]:
    return _rounded(pixels[np.isfinite(pixels[:, 0])])


def _rounded(pixels: FloatArray) -> list[list[float]]:
    rows: list[list[float]] = np.round(pixels, 3).tolist()
    return rows


def _transects(found: River, sample: PoseSample) -> Iterable[dict[str, Any]]:
    measured = {int(row): index for index, row in enumerate(found.rows)}
    ci95, std = found.widths.ci95_m, found.widths.std_m
    assert sample.pose is not None  # noqa: S101 - what was measured has a pose, for the type checker
    hidden = hidden_per_metre(sample.pose, found.widths.points_enu_m)
    for row, status in enumerate(found.status):
        index = measured.get(row)
        keys = (
            "width_m",
            "std",
            "ci95",
            "wetted_m",
            "wetted_std",
            "channels",
            "bound",
            "hidden_m_per_m",
            "points_enu_m",
            "geo",
        )
        answer: dict[str, Any] = dict.fromkeys(keys)
        if index is not None and status is RiverStatus.OK:
            points = found.widths.points_enu_m[index]
            answer = {
                "width_m": float(found.widths.width_m[index]),
                "std": float(std[index]),
                "ci95": ci95[index].tolist(),
                "wetted_m": float(found.widths.width_m[index] - found.islands.dry_m[row]),
                "wetted_std": math.hypot(float(std[index]), float(found.islands.std_m[row])),
                "channels": int(found.islands.count[row]) + 1,
                "bound": "at_least" if hidden[index].max() >= ONE_SIDED else None,
                "hidden_m_per_m": hidden[index].tolist(),
                "points_enu_m": points.tolist(),
                "geo": geo_of(sample, points),
            }
        ends = zip(_SIDES, found.edges.pixels_px[row], found.edges.std_px[row], strict=True)
        sides = {side: (pixel, px) for side, pixel, px in ends if math.isfinite(pixel[0])}
        yield {
            "station_m": float(found.transects.stations_m[row]),
            **{side: _rounded(sides[side][0]) if side in sides else None for side in _SIDES},
            **answer,
            "status": str(status),
            "reason": WHY.get(status),
            "bank_std_px": [float(sides[side][1]) if side in sides else None for side in _SIDES],
        }


def geo_of(sample: PoseSample, points_enu_m: FloatArray) -> list[dict[str, float]] | None:
    """Places of points ``(n, 3)``; None where the pose's is not known."""
    if sample.origin is None:
        return None
    places = np.degrees(lat_lon(sample.origin, points_enu_m[:, :2]))
    return [{"lat": float(lat), "lon": float(lon)} for lat, lon in places]
