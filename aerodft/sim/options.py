"""``tilt=0.3,height=1``: the simulator's numbers as people write them."""

import math
import re
from collections.abc import Mapping

from aerodft.conventions import SECOND_NS
from aerodft.errors import UsageError
from aerodft.model.pose import PoseStd
from aerodft.sim.telemetry import Biases, Radio

_MOST = 1e5  # metres, degrees, seconds, pixels: what fits into MAVLink's integers
_MOST_CLOCK_S = 1e9
_ANGLES = ("tilt", "pan", "roll", "heading")
_SHARES = ("drop", "duplicate", "reorder")


def parse_size(text: str) -> tuple[int, int]:
    """``1280x720``: width and height in pixels, even, as H.264 wants them.

    Raises:
        UsageError: Anything else.
    """
    match = re.fullmatch(r"(\d{2,5})x(\d{2,5})", text)
    if match is None or int(match[1]) % 2 or int(match[2]) % 2:
        raise UsageError("--size", got=text, expected="two even numbers like 1280x720")
    return int(match[1]), int(match[2])


def parse_stds(option: str, text: str) -> PoseStd:
    """Height and position in m, tilt, pan, roll, heading in degrees, none below 0."""
    given = _pairs(option, text, ("height", "position", *_ANGLES), lowest=0.0)
    return PoseStd(height_agl_m=given["height"], horizontal_m=given["position"], **_angles_rad(given))


def parse_biases(option: str, text: str) -> Biases:
    """Height in m, tilt, pan, roll, heading in degrees."""
    given = _pairs(option, text, ("height", *_ANGLES), lowest=-_MOST)
    return Biases(height_m=given["height"], **_angles_rad(given))


def _angles_rad(given: Mapping[str, float]) -> dict[str, float]:
    return {f"{name}_rad": math.radians(given[name]) for name in _ANGLES}


def parse_radio(option: str, text: str, *, seed: int) -> Radio:
    """Latency and jitter in seconds; drop, duplicate, reorder as shares; one outage from ``mute`` to ``unmute`` (s)."""
    names = ("latency", "jitter", "drop", "duplicate", "reorder", "mute", "unmute")
    given = _pairs(option, text, names, lowest=0.0, most=dict.fromkeys(_SHARES, 1.0))
    outage = (round(given["mute"] * SECOND_NS), round(given["unmute"] * SECOND_NS))
    return Radio(
        latency_ns=round(given["latency"] * SECOND_NS),
        jitter_ns=round(given["jitter"] * SECOND_NS),
        drop=given["drop"],
        duplicate=given["duplicate"],
        reorder=given["reorder"],
        outages_ns=(outage,) if outage[1] > outage[0] else (),
        seed=seed,
    )


def parse_numbers(option: str, text: str, **defaults: float) -> dict[str, float]:
    """Numbers of at least 0 by name."""
    given = _pairs(option, text, tuple(defaults), lowest=0.0)
    named = {part.partition("=")[0].strip() for part in text.split(",")}
    return {name: given[name] if name in named else value for name, value in defaults.items()}


def parse_autopilot(option: str, text: str) -> tuple[int, int]:
    """Lag of the camera behind the gimbal's reports, and the autopilot's UTC minus the host's: s in, ns out."""
    given = _pairs(option, text, ("lag", "clock"), lowest=-_MOST, most={"clock": _MOST_CLOCK_S})
    if given["lag"] < 0:
        raise UsageError(f"{option} lag", got=given["lag"], expected="a number of at least 0")
    return round(given["lag"] * SECOND_NS), round(given["clock"] * SECOND_NS)


def _pairs(
    option: str, text: str, names: tuple[str, ...], *, lowest: float, most: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Every name with its value, 0 where it is not given.

    Raises:
        UsageError: An unknown name, or a value that is no number from ``lowest`` to the name's ``most``.
    """
    values = dict.fromkeys(names, 0.0)
    for part in filter(None, (piece.strip() for piece in text.split(","))):
        name, _, number = part.partition("=")
        if name not in values:
            raise UsageError(f"{option} {part}", got=f"name {name!r}", expected=f"one of {', '.join(names)}")
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        limit = (most or {}).get(name, _MOST)
        least = -limit if lowest < 0 else lowest
        if not least <= value <= limit:
            expected = f"a number of at least {least:g}, at most {limit:g}, e.g. {name}=0.3"
            raise UsageError(f"{option} {part}", got=repr(number), expected=expected)
        values[name] = value
    return values
