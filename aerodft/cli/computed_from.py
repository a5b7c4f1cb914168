"""What a recomputed recording says of the one that it was computed from: beside its segments, and in each of them."""

import tomllib
from typing import Any, Final

import tomli_w

from aerodft.cli.recomputing import Recomputation
from aerodft.errors import InputError
from replay.dataset import recording_hash
from replay.recording import Recording

COMPUTED_FROM: Final = "computed_from.toml"


def computed_from(ready: Recomputation) -> dict[str, Any]:
    """The recording's own provenance, which its new measurements no longer name; ids are those in its measurements.

    Where it was computed from another one itself, what it says of that one is in it, under ``computed_from``.

    Raises:
        InputError: A segment cannot be read.
    """
    old, was = ready.recording, ready.was
    known = {
        "recording": str(old.folder.resolve()),
        "recording_sha256": recording_hash([segment.path for segment in old.data]),
        "station": was.pipeline.station,
        "camera": was.pipeline.camera.name,
        "config": was.pipeline.config_id,
        "calibration": None if was.calibration is None else was.calibration.id,
        "config_toml": old.text("config.toml"),
        "computed_from": _before(old),
    }
    return {key: value for key, value in known.items() if value is not None}


def computed_from_toml(document: dict[str, Any]) -> str:
    """The document as a file that people read."""
    return tomli_w.dumps(document, multiline_strings=True)


def _before(recording: Recording) -> dict[str, Any] | None:
    text = recording.text(COMPUTED_FROM)
    if text is None:
        return None
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError("the file is no TOML", where=recording.folder / COMPUTED_FROM, got=error) from error
