"""COLMAP's cameras.txt.

Pixels count from the corner of the top-left one, whose centre is (0.5, 0.5). Distortion is OpenCV's.
"""

import re
from typing import Any, Final

from aerodft.adapters.config.camera.formats.values import Values, camera_keys, named_distortion, refused_model
from aerodft.errors import ConfigError, counted
from aerodft.model import LensModel

_CENTRE_OF_FIRST_PX: Final = 0.5
_LINE: Final = re.compile(r"\d+\s+([A-Z][A-Z_]+)\s+(\S+)\s+(\S+)((?:\s+\S+)+)")
_MODELS: Final = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
    "SIMPLE_RADIAL_FISHEYE": "f cx cy k1",
    "RADIAL_FISHEYE": "f cx cy k1 k2",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
}


def recognises(text: str) -> bool:
    """Whether the first line that is no comment is a camera of COLMAP."""
    lines = _lines(text[:10_000])
    return bool(lines) and _LINE.match(lines[0]) is not None


def read(text: str) -> dict[str, Any]:
    """Keys of a camera file.

    Raises:
        ConfigError: Several cameras, a missing or impossible value, or an unknown model.
    """
    lines = _lines(text)
    if len(lines) > 1:
        raise ConfigError(
            "its cameras", got=counted(len(lines), "camera"), expected="one", hint="keep one line of them"
        )
    found = _LINE.fullmatch(lines[0])
    if found is None:
        raise ConfigError("its camera", got=lines[0][:62], expected="CAMERA_ID MODEL WIDTH HEIGHT PARAMS")
    model, width, height, params = found.groups()
    if model not in _MODELS:
        raise refused_model("MODEL", model, _MODELS)
    names, numbers = _MODELS[model].split(), params.split()
    if len(numbers) != len(names):
        got = f"{len(numbers)} numbers"
        raise ConfigError("PARAMS", got=got, expected=f"{len(names)} of {model}: {', '.join(names)}")
    values = Values(dict(zip(names, numbers, strict=True)) | {"WIDTH": width, "HEIGHT": height})
    lens = LensModel.FISHEYE if model.endswith("FISHEYE") else LensModel.BROWN
    matrix = (
        values.positive(values.key_of("fx", "f")),
        values.positive(values.key_of("fy", "f")),
        values.number("cx") - _CENTRE_OF_FIRST_PX,
        values.number("cy") - _CENTRE_OF_FIRST_PX,
    )
    distortion = named_distortion(lens, {name: values.number(name) for name in names if name[0] in "kp"})
    return camera_keys((values.size_px("WIDTH"), values.size_px("HEIGHT")), matrix, lens, distortion, "PARAMS")


def _lines(text: str) -> list[str]:
    """Lines that are neither empty nor comments."""
    return [line for each in text.splitlines() if (line := each.strip()) and not line.startswith("#")]
