"""aerodft turns aerial images and telemetry into measurements with an honest uncertainty.

The names below are all that a script, a notebook or a page needs. Each is loaded when it is first asked for, so that
``import aerodft`` itself is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Final

from aerodft.version import VERSION

if TYPE_CHECKING:
    from aerodft.adapters.recording.recover import Recovery
    from aerodft.app.align import VideoAlignment, align
    from aerodft.app.assembly import RunResult
    from aerodft.app.calibrate import CalibrationResult, calibrate
    from aerodft.app.calibrate_lens import LensCalibration, calibrate_lens, print_board
    from aerodft.app.diagnose import Diagnosis, LinkOptions, diagnose
    from aerodft.app.importing import import_flight
    from aerodft.app.recompute import RecomputeResult, recompute
    from aerodft.app.recordings import (
        ExportSummary,
        Measurements,
        StationRecording,
        compare,
        export,
        open_recording,
        recover,
    )
    from aerodft.app.station import Station
    from aerodft.errors import AerodftError, ConfigError, InputError, NoAnswerError, NotDetermined
    from replay.compare import Comparison

__version__ = VERSION

_ROOM_OF: Final = {
    "AerodftError": "aerodft.errors",
    "CalibrationResult": "aerodft.app.calibrate",
    "Comparison": "replay.compare",
    "ConfigError": "aerodft.errors",
    "Diagnosis": "aerodft.app.diagnose",
    "ExportSummary": "aerodft.app.recordings",
    "InputError": "aerodft.errors",
    "LensCalibration": "aerodft.app.calibrate_lens",
    "LinkOptions": "aerodft.app.diagnose",
    "Measurements": "aerodft.app.recordings",
    "NoAnswerError": "aerodft.errors",
    "NotDetermined": "aerodft.errors",
    "RecomputeResult": "aerodft.app.recompute",
    "Recovery": "aerodft.adapters.recording.recover",
    "RunResult": "aerodft.app.assembly",
    "Station": "aerodft.app.station",
    "StationRecording": "aerodft.app.recordings",
    "VideoAlignment": "aerodft.app.align",
    "align": "aerodft.app.align",
    "calibrate": "aerodft.app.calibrate",
    "calibrate_lens": "aerodft.app.calibrate_lens",
    "compare": "aerodft.app.recordings",
    "diagnose": "aerodft.app.diagnose",
    "export": "aerodft.app.recordings",
    "import_flight": "aerodft.app.importing",
    "open_recording": "aerodft.app.recordings",
    "print_board": "aerodft.app.calibrate_lens",
    "recompute": "aerodft.app.recompute",
    "recover": "aerodft.app.recordings",
}

__all__ = [
    "AerodftError",
    "CalibrationResult",
    "Comparison",
    "ConfigError",
    "Diagnosis",
    "ExportSummary",
    "InputError",
    "LensCalibration",
    "LinkOptions",
    "Measurements",
    "NoAnswerError",
    "NotDetermined",
    "RecomputeResult",
    "Recovery",
    "RunResult",
    "Station",
    "StationRecording",
    "VideoAlignment",
    "__version__",
    "align",
    "calibrate",
    "calibrate_lens",
    "compare",
    "diagnose",
    "export",
    "import_flight",
    "open_recording",
    "print_board",
    "recompute",
    "recover",
]


def __getattr__(name: str) -> object:
    """The public name, out of the room that defines it."""
    if name not in _ROOM_OF:
        raise AttributeError(f"module 'aerodft' has no attribute {name!r}")
    return getattr(import_module(_ROOM_OF[name]), name)


def __dir__() -> list[str]:
    """The public names, also before they are loaded."""
    return sorted(__all__)
