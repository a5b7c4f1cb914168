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
        Photograph,
        PoseStd,
        Position,
        Range,
        RiverWidth,
        Slope,
        StatedPose,
        Width,
        ground_points,
        known_points,
        measure,
        probe,
        project,
        read_photograph,
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
    from aerodft.errors import AerodftError, ConfigError, InputError, NoAnswerError, NotDetermined, UsageError
    from aerodft.model import Camera, KnownPoint, Measurement, Status
    from replay.compare import Comparison

__version__ = VERSION

_NAMES_IN: Final = {
    "aerodft.adapters.config.camera": "load_camera",
    "aerodft.adapters.recording.recover": "Recovery",
    "aerodft.app.align": "VideoAlignment align",
    "aerodft.app.assembly": "RunResult",
    "aerodft.app.calibrate": "CalibrationResult calibrate",
    "aerodft.app.calibrate_lens": "LensCalibration calibrate_lens print_board",
    "aerodft.app.diagnose": "Diagnosis LinkOptions diagnose",
    "aerodft.app.importing": "import_flight",
    "aerodft.app.measure": (
        "Area Bearing CameraPose Distance ElevationModel Height Length Photograph PoseStd Position Range RiverWidth "
        "Slope StatedPose Width ground_points known_points measure probe project read_photograph"
    ),
    "aerodft.app.recompute": "RecomputeResult recompute",
    "aerodft.app.recordings": (
        "ExportSummary Measurements StationRecording compare export open_recording recover report"
    ),
    "aerodft.app.river": "RiverSurvey survey_river",
    "aerodft.app.setup": "StationDraft draft_station find_cameras write_camera",
    "aerodft.app.station": "Station",
    "aerodft.errors": "AerodftError ConfigError InputError NoAnswerError NotDetermined UsageError",
    "aerodft.model": "Camera KnownPoint Measurement Status",
    "replay.compare": "Comparison",
}
_ROOM_OF: Final = {name: room for room, names in _NAMES_IN.items() for name in names.split()}

__all__ = [
    "AerodftError",
    "Area",
    "Bearing",
    "CalibrationResult",
    "Camera",
    "CameraPose",
    "Comparison",
    "ConfigError",
    "Diagnosis",
    "Distance",
    "ElevationModel",
    "ExportSummary",
    "Height",
    "InputError",
    "KnownPoint",
    "Length",
    "LensCalibration",
    "LinkOptions",
    "Measurement",
    "Measurements",
    "NoAnswerError",
    "NotDetermined",
    "Photograph",
    "PoseStd",
    "Position",
    "Range",
    "RecomputeResult",
    "Recovery",
    "RiverSurvey",
    "RiverWidth",
    "RunResult",
    "Slope",
    "StatedPose",
    "Station",
    "StationDraft",
    "StationRecording",
    "Status",
    "UsageError",
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
    "known_points",
    "load_camera",
    "measure",
    "open_recording",
    "print_board",
    "probe",
    "project",
    "read_photograph",
    "recompute",
    "recover",
    "report",
    "survey_river",
    "write_camera",
]


def __getattr__(name: str) -> object:
    """The public name, out of the room that defines it."""
    if name in _ROOM_OF:
        return getattr(import_module(_ROOM_OF[name]), name)
    if name[:1].isupper():  # the class of a kind of probe that somebody has added
        added = import_module("aerodft.app.measure").probe_classes()
        if name in added:
            return added[name]
    raise AttributeError(f"module 'aerodft' has no attribute {name!r}")


def __dir__() -> list[str]:
    """The public names, also before they are loaded."""
    return sorted(__all__)
