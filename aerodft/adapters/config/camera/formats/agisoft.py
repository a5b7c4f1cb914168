"""Agisoft's calibration XML (PhotoScan, Metashape): alone, or in an export of cameras.

Metashape's manual, appendix on camera models: u = w / 2 + cx + x' (f + b1) + y' b2, v = h / 2 + cy + y' f, where
(0.5, 0.5) is the centre of the top-left pixel. P1 and P2 are OpenCV's p2 and p1.
"""

from typing import Any, Final
from xml.etree import ElementTree as ET

from aerodft.adapters.config.camera.formats.syntax import xml_root
from aerodft.adapters.config.camera.formats.values import (
    Values,
    camera_keys,
    named_distortion,
    refuse_unless_zero,
    refused_model,
)
from aerodft.errors import ConfigError
from aerodft.model import LensModel

_FISHEYE: Final = LensModel.FISHEYE, ("p1", "p2")
_MODELS: Final = {"frame": (LensModel.BROWN, ("k4",)), "fisheye": _FISHEYE, "equidistant_fisheye": _FISHEYE}
"""The equal of each model, and the coefficients that it lacks: Agisoft's k4 is no denominator."""
_RADIAL: Final = ("k1", "k2", "k3", "k4")


def recognises(text: str) -> bool:
    """Whether the text is XML with a calibration in it."""
    return text.lstrip()[:1] == "<" and "<calibration" in text


def read(text: str) -> dict[str, Any]:
    """Keys of a camera file.

    Raises:
        ConfigError: Several calibrations, a missing or impossible value, or an unknown model.
    """
    found = list(xml_root(text).iter("calibration"))
    adjusted = [each for each in found if each.get("class") == "adjusted"]
    calibrations = adjusted or found
    if len(calibrations) != 1:
        hint = "export the calibration of one camera"
        raise ConfigError("calibration", got=f"{len(calibrations)} of them", expected="one", hint=hint)
    values = Values(_table(calibrations[0]), "calibration.")
    model = values.text("projection", "frame")
    if model not in _MODELS:
        raise refused_model(values.path("projection"), model, _MODELS)
    if "f" not in values and "fx" in values:
        raise ConfigError(values.path("fx"), got="an old file of Agisoft Lens", expected="f", hint="export it anew")
    return _read(values, *_MODELS[model])


def _read(values: Values, lens: LensModel, lacking: tuple[str, ...]) -> dict[str, Any]:
    refuse_unless_zero(values, ("b2", "p3", "p4", *lacking))
    width, height = values.size_px("width"), values.size_px("height")
    focal_px = values.positive("f")
    matrix = (
        focal_px + values.number("b1", 0.0),
        focal_px,
        (width - 1) / 2 + values.number("cx", 0.0),
        (height - 1) / 2 + values.number("cy", 0.0),
    )
    coefficients = {key: values.number(key, 0.0) for key in _RADIAL}
    coefficients |= {"p1": values.number("p2", 0.0), "p2": values.number("p1", 0.0)}
    return camera_keys((width, height), matrix, lens, named_distortion(lens, coefficients), values.path("k1"))


def _table(calibration: ET.Element) -> dict[str, Any]:
    """Values of a calibration by their names; the size is in elements, or in attributes of one."""
    table: dict[str, Any] = {each.tag: each.text for each in calibration}
    resolution = calibration.find("resolution")
    if resolution is not None:
        table |= resolution.attrib
    kind = calibration.get("type")
    return table if kind is None else table | {"projection": kind}
