"""aerodft turns aerial images and telemetry into measurements with an honest uncertainty.

The names below are all that a script, a notebook or a page needs. Each is loaded when it is first asked for, so that
``import aerodft`` itself is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Final

from aerodft.version import VERSION

if TYPE_CHECKING:
    from aerodft.app.align import VideoAlignment, align
    from aerodft.app.assembly import RunResult
    from aerodft.app.importing import import_flight
    from aerodft.app.recompute import RecomputeResult, recompute
    from aerodft.app.station import Station
    from aerodft.errors import AerodftError, ConfigError, InputError, NoAnswerError

__version__ = VERSION

_ROOM_OF: Final = {
    "AerodftError": "aerodft.errors",
    "VideoAlignment": "aerodft.app.align",
    "align": "aerodft.app.align",
    "ConfigError": "aerodft.errors",
    "InputError": "aerodft.errors",
    "NoAnswerError": "aerodft.errors",
    "RecomputeResult": "aerodft.app.recompute",
    "RunResult": "aerodft.app.assembly",
    "Station": "aerodft.app.station",
    "import_flight": "aerodft.app.importing",
    "recompute": "aerodft.app.recompute",
}

__all__ = [
    "AerodftError",
    "ConfigError",
    "InputError",
    "NoAnswerError",
    "RecomputeResult",
    "RunResult",
    "Station",
    "VideoAlignment",
    "__version__",
    "align",
    "import_flight",
    "recompute",
]


def __getattr__(name: str) -> object:
    """The public name, out of the room that defines it."""
    if name not in _ROOM_OF:
        raise AttributeError(f"module 'aerodft' has no attribute {name!r}")
    return getattr(import_module(_ROOM_OF[name]), name)


def __dir__() -> list[str]:
    """The public names, also before they are loaded."""
    return sorted(__all__)
