"""aerodft turns aerial images and telemetry into measurements with an honest uncertainty.

The names below are all that a script, a notebook or a page needs. Each is loaded when it is first asked for, so that
``import aerodft`` itself is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Final

from aerodft.version import VERSION

if TYPE_CHECKING:
    from aerodft.adapters.config.camera import load_camera
    from aerodft.app.calibrate import CalibrationResult, calibrate
    from aerodft.app.calibrate_lens import LensCalibration, calibrate_lens, print_board
    from aerodft.app.measure import (
        Area,
        Bearing,
        CameraPose,
        Distance,
        ElevationModel,
        Height,
        Length,
        PoseStd,
        Position,
        Range,
        RiverWidth,
        Slope,
        Width,
        ground_points,
        measure,
    )
    from aerodft.app.river import RiverSurvey, survey_river
    from aerodft.errors import AerodftError, ConfigError, InputError, NoAnswerError, NotDetermined

__version__ = VERSION

_ROOM_OF: Final = {
    "AerodftError": "aerodft.errors",
    "Area": "aerodft.app.measure",
    "Bearing": "aerodft.app.measure",
    "CalibrationResult": "aerodft.app.calibrate",
    "CameraPose": "aerodft.app.measure",
    "ConfigError": "aerodft.errors",
    "Distance": "aerodft.app.measure",
    "ElevationModel": "aerodft.app.measure",
    "Height": "aerodft.app.measure",
    "InputError": "aerodft.errors",
    "Length": "aerodft.app.measure",
    "LensCalibration": "aerodft.app.calibrate_lens",
    "NoAnswerError": "aerodft.errors",
    "NotDetermined": "aerodft.errors",
    "PoseStd": "aerodft.app.measure",
    "Position": "aerodft.app.measure",
    "Range": "aerodft.app.measure",
    "RiverSurvey": "aerodft.app.river",
    "RiverWidth": "aerodft.app.measure",
    "Slope": "aerodft.app.measure",
    "Width": "aerodft.app.measure",
    "calibrate": "aerodft.app.calibrate",
    "calibrate_lens": "aerodft.app.calibrate_lens",
    "ground_points": "aerodft.app.measure",
    "load_camera": "aerodft.adapters.config.camera",
    "measure": "aerodft.app.measure",
    "print_board": "aerodft.app.calibrate_lens",
    "survey_river": "aerodft.app.river",
}

__all__ = [
    "AerodftError",
    "Area",
    "Bearing",
    "CalibrationResult",
    "CameraPose",
    "ConfigError",
    "Distance",
    "ElevationModel",
    "Height",
    "InputError",
    "Length",
    "LensCalibration",
    "NoAnswerError",
    "NotDetermined",
    "PoseStd",
    "Position",
    "Range",
    "RiverSurvey",
    "RiverWidth",
    "Slope",
    "Width",
    "__version__",
    "calibrate",
    "calibrate_lens",
    "ground_points",
    "load_camera",
    "measure",
    "print_board",
    "survey_river",
]


def __getattr__(name: str) -> object:
    """The public name, out of the room that defines it."""
    if name not in _ROOM_OF:
        raise AttributeError(f"module 'aerodft' has no attribute {name!r}")
    return getattr(import_module(_ROOM_OF[name]), name)


def __dir__() -> list[str]:
    """The public names, also before they are loaded."""
    return sorted(__all__)
