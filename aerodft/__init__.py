"""aerodft turns aerial images and telemetry into measurements with an honest uncertainty.

The names below are all that a script, a notebook or a page needs. Each is loaded when it is first asked for, so that
``import aerodft`` itself is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Final

from aerodft.version import VERSION

if TYPE_CHECKING:
    from aerodft.adapters.config.camera import load_camera
    from aerodft.adapters.recording.recover import Recovery
    from aerodft.app.align import VideoAlignment, align
    from aerodft.app.assembly import RunResult
    from aerodft.app.calibrate import CalibrationResult, calibrate
    from aerodft.app.calibrate_lens import LensCalibration, calibrate_lens, print_board
    from aerodft.app.diagnose import Diagnosis, LinkOptions, diagnose
    from aerodft.app.importing import import_flight
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
    from aerodft.app.recompute import RecomputeResult, recompute
    from aerodft.app.recordings import (
        ExportSummary,
        Measurements,
        StationRecording,
        compare,
        export,
        open_recording,
        recover,
        report,
    )
    from aerodft.app.river import RiverSurvey, survey_river
    from aerodft.app.setup import StationDraft, draft_station, find_cameras, write_camera
    from aerodft.app.station import Station
    from aerodft.errors import AerodftError, ConfigError, InputError, NoAnswerError, NotDetermined
    from replay.compare import Comparison

__version__ = VERSION

_ROOM_OF: Final = {
    "AerodftError": "aerodft.errors",
    "Area": "aerodft.app.measure",
    "Bearing": "aerodft.app.measure",
    "CalibrationResult": "aerodft.app.calibrate",
    "CameraPose": "aerodft.app.measure",
    "Comparison": "replay.compare",
    "ConfigError": "aerodft.errors",
    "Diagnosis": "aerodft.app.diagnose",
    "Distance": "aerodft.app.measure",
    "ElevationModel": "aerodft.app.measure",
    "ExportSummary": "aerodft.app.recordings",
    "Height": "aerodft.app.measure",
    "InputError": "aerodft.errors",
    "Length": "aerodft.app.measure",
    "LensCalibration": "aerodft.app.calibrate_lens",
    "LinkOptions": "aerodft.app.diagnose",
    "Measurements": "aerodft.app.recordings",
    "NoAnswerError": "aerodft.errors",
    "NotDetermined": "aerodft.errors",
    "PoseStd": "aerodft.app.measure",
    "Position": "aerodft.app.measure",
    "Range": "aerodft.app.measure",
    "RecomputeResult": "aerodft.app.recompute",
    "Recovery": "aerodft.adapters.recording.recover",
    "RiverSurvey": "aerodft.app.river",
    "RiverWidth": "aerodft.app.measure",
    "RunResult": "aerodft.app.assembly",
    "Slope": "aerodft.app.measure",
    "Station": "aerodft.app.station",
    "StationDraft": "aerodft.app.setup",
    "StationRecording": "aerodft.app.recordings",
    "VideoAlignment": "aerodft.app.align",
    "Width": "aerodft.app.measure",
    "align": "aerodft.app.align",
    "calibrate": "aerodft.app.calibrate",
    "calibrate_lens": "aerodft.app.calibrate_lens",
    "compare": "aerodft.app.recordings",
    "diagnose": "aerodft.app.diagnose",
    "draft_station": "aerodft.app.setup",
    "export": "aerodft.app.recordings",
    "find_cameras": "aerodft.app.setup",
    "ground_points": "aerodft.app.measure",
    "import_flight": "aerodft.app.importing",
    "load_camera": "aerodft.adapters.config.camera",
    "measure": "aerodft.app.measure",
    "open_recording": "aerodft.app.recordings",
    "print_board": "aerodft.app.calibrate_lens",
    "recompute": "aerodft.app.recompute",
    "recover": "aerodft.app.recordings",
    "report": "aerodft.app.recordings",
    "survey_river": "aerodft.app.river",
    "write_camera": "aerodft.app.setup",
}

__all__ = [
    "AerodftError",
    "Area",
    "Bearing",
    "CalibrationResult",
    "CameraPose",
    "Comparison",
    "ConfigError",
    "Diagnosis",
    "Distance",
    "ElevationModel",
    "ExportSummary",
    "Height",
    "InputError",
    "Length",
    "LensCalibration",
    "LinkOptions",
    "Measurements",
    "NoAnswerError",
    "NotDetermined",
    "PoseStd",
    "Position",
    "Range",
    "RecomputeResult",
    "Recovery",
    "RiverSurvey",
    "RiverWidth",
    "RunResult",
    "Slope",
    "Station",
    "StationDraft",
    "StationRecording",
    "VideoAlignment",
    "Width",
    "__version__",
    "align",
    "calibrate",
    "calibrate_lens",
    "compare",
    "diagnose",
    "draft_station",
    "export",
    "find_cameras",
    "ground_points",
    "import_flight",
    "load_camera",
    "measure",
    "open_recording",
    "print_board",
    "recompute",
    "recover",
    "report",
    "survey_river",
    "write_camera",
]


def __getattr__(name: str) -> object:
    """The public name, out of the room that defines it."""
    if name not in _ROOM_OF:
        raise AttributeError(f"module 'aerodft' has no attribute {name!r}")
    return getattr(import_module(_ROOM_OF[name]), name)


def __dir__() -> list[str]:
    """The public names, also before they are loaded."""
    return sorted(__all__)
