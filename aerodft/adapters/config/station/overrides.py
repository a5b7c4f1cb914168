"""Changes of a station's document before it is read: single keys, and the alignment of a recorded video."""

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, TypeAlias

from aerodft.errors import ConfigError

Settings: TypeAlias = Mapping[str, Any]
"""Values by dotted key of the station file, such as ``telemetry.height.home_above_plane_m``; TOML's own types."""

NO_SETTINGS: Final[Settings] = {}

HOME_ABOVE_PLANE: Final = "telemetry.height.home_above_plane_m"
"""Key of the take-off point's height above the measured plane."""

_HOME_STD: Final = "telemetry.height.home_above_plane_std_m"
_FILE_KEYS: Final = ("camera.file", "telemetry.calibration", "pose.calibration", "ground.terrain", "ground.level")
_REPLACED_KEYS: Final[Mapping[str, tuple[str, ...]]] = {
    "ground.level": ("level_m",),
    "ground.level_m": ("level", "level_unit", "level_columns", "level_utc_offset", "level_max_gap_s"),
}
"""Keys that take the place of others: one level of the water, or the readings of a gauge."""

_CLOCK_KEYS: Final = ("time_offset_s", "time_drift", "time_reference")
_INPUT_KEYS: Final = ("video", "stills", "stream", "device")
_LAG_KEYS: Final = ("delay_s", "lag_s")


def with_settings(document: Mapping[str, Any], settings: Settings) -> dict[str, Any]:
    """A station's document with some of its keys replaced.

    A probe, landmark or other entry of a list is addressed by its name: ``probe.width-a.elevation_m``. Names of files
    start from the current folder. A stated height of the take-off point ends the std of the one that it replaces.
    One level of the water ends the readings of a gauge, and readings end the one level.

    Args:
        document: The document; it is not changed.
        settings: Values by dotted key.

    Raises:
        ConfigError: A key leads through something that is no table, or to a name that is not in a list.
    """
    changed = copy.deepcopy(dict(document))
    for key, value in settings.items():
        path = key.split(".")
        if not all(path):
            raise ConfigError(f"{key!r}: no key", expected=f"a key of the station file, such as {HOME_ABOVE_PLANE}")
        if path[0] == "telemetry" and "pose" in document:
            got = "a fixed camera, which has no telemetry"
            raise ConfigError(key, got=got, expected="a key of [pose], such as pose.height_agl_m")
        table: Any = changed
        for depth, name in enumerate(path[:-1]):
            table = _entry(table, name, ".".join(path[: depth + 1]))
        if not isinstance(table, dict):
            raise ConfigError(key, got="a list", expected=f"{'.'.join(path[:-1])}.NAME.KEY, with an entry's name")
        if key == "camera.file":  # it replaces the contents of a camera file, which a recorded station has
            changed["camera"] = table = {each: table[each] for each in ("model",) if each in table}
        if key == HOME_ABOVE_PLANE and _HOME_STD not in settings:  # it was that of the value that is replaced
            table.pop(_HOME_STD.rpartition(".")[2], None)
        for other in _REPLACED_KEYS.get(key, ()):
            table.pop(other, None)
        is_file = key in _FILE_KEYS and isinstance(value, str)
        table[path[-1]] = str(Path(value).absolute()) if is_file else value
    return changed


def _entry(table: Any, name: str, key: str) -> Any:  # noqa: ANN401 - TOML's types
    """The table or list under a name, made where there is none; of a list the entry that has the name."""
    if isinstance(table, list):
        names = {each.get("name"): each for each in table}
        if name not in names:
            raise ConfigError(f"{key}: no such entry", expected=f"one of {', '.join(map(str, names))}")
        return names[name]
    within = table.setdefault(name, {})
    if not isinstance(within, dict | list):
        raise ConfigError(key, got="a value", expected="a table")
    return within


def with_alignment(document: Mapping[str, Any], recorded: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
    """A station's document with the clock and the gimbal's lag that an alignment found for a recorded video.

    The alignment is a fact about the recorded images, whichever station they are computed with. A document that states
    a clock of its own, or names other images, is left as it is.

    Args:
        document: The document of another station; it is not changed.
        recorded: The document of the recording's own station.

    Returns:
        The document, and a sentence on what became of the alignment; empty where the recording has none or where the
        document states it too.
    """
    images, aligned = document.get("images", {}), recorded.get("images", {})
    clock = {key: aligned[key] for key in _CLOCK_KEYS if key in aligned}
    if "time_reference" not in clock or not isinstance(images, dict):
        return dict(document), ""
    found = f"the recording's alignment ({clock.get('time_offset_s', 0.0):+.3f} s off its log)"
    stated = {key: images[key] for key in _CLOCK_KEYS if images.get(key, "auto") != "auto"}
    if stated:
        is_same = all(str(stated.get(key)) == str(value) for key, value in clock.items())
        return dict(document), "" if is_same else f"{found} is not kept: images.{next(iter(stated))} is stated"
    inputs = [str(images[key]) for key in _INPUT_KEYS if key in images]
    if inputs and Path(inputs[0]).name != Path(str(aligned.get("video", ""))).name:
        return dict(document), f"{found} is not kept: it is of {aligned.get('video')}, not of {inputs[0]}"
    changed = copy.deepcopy(dict(document))
    changed["images"] = images | clock | {"time_std_s": aligned.get("time_std_s", 0.0)}
    if isinstance(telemetry := changed.get("telemetry"), dict):
        lags = recorded.get("telemetry", {}).get("attitude", {})
        kept = {key: lags[key] for key in _LAG_KEYS if key in lags}
        telemetry["attitude"] = kept | telemetry.get("attitude", {})
    return changed, f"{found} is kept; state images.time_offset_s to replace it"
