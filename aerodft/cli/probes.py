"""``--probe "distance 812,604.5 1377,611 elevation=0.5"``: probes as people write them."""

import math

from aerodft.cli.stds import Stds
from aerodft.conventions import LARGEST
from aerodft.errors import UsageError
from aerodft.model.probe import Probe, ProbeKind, pixels_wanted, takes_pixels

_OPTIONS = ("elevation", "name")


def parse_probe(text: str, index: int, stds: Stds) -> Probe:
    """Read one ``--probe``: a kind, as many ``u,v`` as it needs, and ``key=value`` options.

    Raises:
        UsageError: An unknown kind or option, a malformed pixel, or too many or too few of them.
    """
    kind_text, *words = text.split() or [""]
    try:
        kind = ProbeKind(kind_text)
    except ValueError:
        kinds = ", ".join(ProbeKind)
        raise UsageError(f'--probe "{text}"', got=f"kind {kind_text!r}", expected=f"one of {kinds}") from None
    options = dict(_option(word, text) for word in words if "=" in word)
    pixels = tuple(_pixel(word, text) for word in words if "=" not in word)
    if not takes_pixels(kind, len(pixels)):
        raise UsageError(f'--probe "{text}"', got=f"{len(pixels)} pixels", expected=f"{pixels_wanted(kind)} for {kind}")
    return Probe(
        name=options.get("name", f"{kind}-{index + 1}"),
        kind=kind,
        pixels=pixels,
        std_px=stds.px,
        elevation_m=_finite(options.get("elevation", "0"), text),
        elevation_std_m=stds.elevation_m,
    )


def _option(word: str, text: str) -> tuple[str, str]:
    key, _, value = word.partition("=")
    if key not in _OPTIONS:
        raise UsageError(f'--probe "{text}"', got=f"option {key!r}", expected=f"one of {', '.join(_OPTIONS)}")
    if not value:
        raise UsageError(f'--probe "{text}"', got="nothing", expected=f"a value after {key}=")
    return key, value


def _pixel(word: str, text: str) -> tuple[float, float]:
    parts = word.split(",")
    if len(parts) != 2:  # noqa: PLR2004 - u and v
        raise UsageError(f'--probe "{text}"', got=repr(word), expected="a pixel as u,v")
    return _finite(parts[0], text), _finite(parts[1], text)


def _finite(number: str, text: str) -> float:
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not abs(value) <= LARGEST:
        raise UsageError(f'--probe "{text}"', got=repr(number), expected="a finite number")
    return value
