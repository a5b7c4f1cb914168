"""aerodft turns aerial images and telemetry into measurements with an honest uncertainty.

The names below are all that a script, a notebook or a page needs. Each is loaded when it is first asked for, so that
``import aerodft`` itself is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Final

from aerodft.version import VERSION

if TYPE_CHECKING:
    from aerodft.app.calibrate import CalibrationResult, calibrate
    from aerodft.app.calibrate_lens import LensCalibration, calibrate_lens, print_board
    from aerodft.errors import AerodftError, ConfigError, InputError, NoAnswerError, NotDetermined

__version__ = VERSION

_ROOM_OF: Final = {
    "AerodftError": "aerodft.errors",
    "CalibrationResult": "aerodft.app.calibrate",
    "ConfigError": "aerodft.errors",
    "InputError": "aerodft.errors",
    "LensCalibration": "aerodft.app.calibrate_lens",
    "NoAnswerError": "aerodft.errors",
    "NotDetermined": "aerodft.errors",
    "calibrate": "aerodft.app.calibrate",
    "calibrate_lens": "aerodft.app.calibrate_lens",
    "print_board": "aerodft.app.calibrate_lens",
}

__all__ = [
    "AerodftError",
    "CalibrationResult",
    "ConfigError",
    "InputError",
    "LensCalibration",
    "NoAnswerError",
    "NotDetermined",
    "__version__",
    "calibrate",
    "calibrate_lens",
    "print_board",
]


def __getattr__(name: str) -> object:
    """The public name, out of the room that defines it."""
    if name not in _ROOM_OF:
        raise AttributeError(f"module 'aerodft' has no attribute {name!r}")
    return getattr(import_module(_ROOM_OF[name]), name)


def __dir__() -> list[str]:
    """The public names, also before they are loaded."""
    return sorted(__all__)
