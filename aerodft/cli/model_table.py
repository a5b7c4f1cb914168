"""``aerodft measure --compare``: the same pixels under both projection models, side by side."""

import math
from collections.abc import Sequence
from typing import Any, Final

from rich.table import Table

from aerodft.adapters.codec.measurement import measurement_payload
from aerodft.cli.output import print_json, tables
from aerodft.dft.equations import tilt_warning
from aerodft.dft.models import ModelDifference
from aerodft.geometry.rotation import camera_angles
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.pose import PoseSample

_LEVEL_RAD: Final = math.radians(0.05)


def model_document(differences: Sequence[ModelDifference]) -> dict[str, list[dict[str, Any]]]:
    """The JSON of ``--compare``: the measurements of both models as on the wire, and what lies between them."""
    return {
        "pinhole": [measurement_payload(item.pinhole) for item in differences],
        "dft": [measurement_payload(item.dft) for item in differences],
        "difference": [_difference(item) for item in differences],
    }


def cautions(camera: Camera, sample: PoseSample) -> list[str]:
    """What the paper's model cannot see of this camera and pose, a sentence each: the horizon (Eq. 1), and roll."""
    if sample.pose is None:
        return []
    tilt_rad, roll_rad, _ = map(float, camera_angles(sample.pose.wxyz))
    past_horizon = tilt_warning(tilt_rad, camera.vfov_rad)
    said = [] if past_horizon is None else [past_horizon]
    if abs(roll_rad) > _LEVEL_RAD:
        said.append(
            f"the paper's camera does not roll: a roll of {math.degrees(roll_rad):.1f} deg is left out under dft"
        )
    return said


def show_models(differences: Sequence[ModelDifference], sample: PoseSample, *, as_json: bool) -> None:
    """Print the comparison: a JSON document, or a table and a sentence on what Eq. 5 does at this tilt."""
    if as_json:
        print_json(model_document(differences))
        return
    table = Table("probe", "", "pinhole", "dft", "difference", "%", "by Eq. 5 (m)", "by angles (m)")
    for item in differences:
        _add(table, item)
    console = tables()
    console.print(table)
    if sample.pose is None:
        return
    tilt_rad, _, _ = camera_angles(sample.pose.wxyz)
    console.print(
        f"In the image's middle, at a tilt of {math.degrees(tilt_rad):.1f} deg, Eq. 5 gives"
        f" {math.sin(tilt_rad):.2f} of the true X; the rest is the paper's angles, linear in pixels."
    )


def _difference(item: ModelDifference) -> dict[str, Any]:
    apart, percent = _apart(item)
    return {
        "name": item.pinhole.name,
        "kind": item.pinhole.kind,
        "value": item.value,
        "unit": item.pinhole.unit,
        "percent": item.percent,
        "ground_m": _listed(item.ground_m),
        "apart_m": apart,
        "apart_percent_of_range": percent,
        "equation_5_m": _listed(item.equation_5_m),
        "angles_m": _listed(item.angles_m),
    }


def _listed(values: FloatArray | None) -> list[Any] | None:
    return None if values is None else values.tolist()


def _apart(item: ModelDifference) -> tuple[list[float] | None, list[float] | None]:
    """How far the two ground points of each pixel are apart, in m and in percent of the pinhole's slant range."""
    if item.ground_m is None or item.pinhole.range_m is None:
        return None, None
    apart = [math.hypot(*row) for row in item.ground_m.tolist()]
    return apart, [100 * m / away for m, away in zip(apart, item.pinhole.range_m, strict=True)]


def _add(table: Table, item: ModelDifference) -> None:
    pinhole, dft = item.pinhole, item.dft
    if pinhole.value is not None or item.ground_m is None:
        values = [str(m.status) if m.value is None else f"{m.value:.3f} {m.unit}" for m in (pinhole, dft)]
        table.add_row(pinhole.name, pinhole.kind, *values, _signed(item.value), _signed(item.percent, 1))
    if item.ground_m is None or pinhole.ground_m is None or dft.ground_m is None:
        return
    _, percents = _apart(item)
    for index, shift in enumerate(item.ground_m.tolist()):
        for axis, letter in enumerate("XY"):
            first = index == axis == 0 and pinhole.value is None
            table.add_row(
                pinhole.name if first else "",
                f"{letter} {index} (m)",
                f"{pinhole.ground_m[index][axis]:.3f}",
                f"{dft.ground_m[index][axis]:.3f}",
                _signed(shift[axis]),
                "" if percents is None or axis else f"{percents[index]:.1f} of range",
                "" if item.equation_5_m is None or axis else _signed(float(item.equation_5_m[index])),
                "" if item.angles_m is None else _signed(float(item.angles_m[index, axis])),
            )


def _signed(number: float | None, digits: int = 3) -> str:
    return "" if number is None else f"{number:+.{digits}f}"
