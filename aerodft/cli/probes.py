"""``--probe "distance 812,604.5 1377,611 elevation=0.5"``: probes as people write them."""

import math

from aerodft.cli.pose_options import Stds
from aerodft.conventions import LARGEST
from aerodft.dft import PROBE_KINDS, Request, linked
from aerodft.errors import UsageError
from aerodft.model import Probe, ProbeKind

_OPTIONS = ("elevation", "name")


def parse_probes(texts: list[str], stds: Stds, elevation_m: float) -> tuple[Request, ...]:
    """Read all ``--probe`` of one command.

    Args:
        texts: A kind, as many ``u,v`` as it needs, and ``key=value`` options each. ``elevation`` is a number, or the
            name of a ``height`` on whose object's top the probe lies.
        stds: Of pixels and elevations.
        elevation_m: Of probes that have no ``elevation``.

    Raises:
        UsageError: An unknown kind, option or name, a name twice, a malformed pixel, or too many or too few of them.
    """
    probes = [_probe(text, index, stds, elevation_m) for index, text in enumerate(texts)]
    for index, probe in enumerate(probes):
        if probe.name in [other.name for other in probes[:index]]:
            raise UsageError(f'--probe "{texts[index]}"', got=f"the name {probe.name} again", expected="its own name")
    try:
        return linked(Request(probe=probe, pixels=probe.pixels, std_px=probe.std_px) for probe in probes)
    except ValueError as error:
        raise UsageError(
            "--probe ... elevation=NAME", got=str(error), expected="a number, or a height's name"
        ) from None


def _probe(text: str, index: int, stds: Stds, elevation_m: float) -> Probe:
    kind_text, *words = text.split() or [""]
    kind = PROBE_KINDS.get(ProbeKind(kind_text))
    if kind is None:
        kinds = ", ".join(PROBE_KINDS)
        raise UsageError(f'--probe "{text}"', got=f"kind {kind_text!r}", expected=f"one of {kinds}")
    options = _options(words, text)
    pixels = tuple(_pixel(word, text) for word in words if "=" not in word)
    if not kind.takes_pixels(len(pixels)):
        expected = f"{kind.pixels_wanted} for {kind.name}"
        raise UsageError(f'--probe "{text}"', got=f"{len(pixels)} pixels", expected=expected)
    elevation = options.get("elevation", "")
    named = elevation != "" and not _is_number(elevation)
    number_m = _finite(elevation, text) if elevation and not named else elevation_m
    return Probe(
        name=options.get("name", f"{kind.name}-{index + 1}"),
        kind=kind.name,
        pixels=pixels,
        std_px=stds.px,
        elevation_m=0.0 if named else number_m,
        elevation_std_m=stds.elevation_m,
        on_top_of=elevation if named else None,
    )


def _options(words: list[str], text: str) -> dict[str, str]:
    options: dict[str, str] = {}
    for key, value in (_option(word, text) for word in words if "=" in word):
        if key in options:
            raise UsageError(f'--probe "{text}"', got=f"{key} again", expected="each option once")
        options[key] = value
    return options


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


def _is_number(word: str) -> bool:
    """Whether it is one of a kind: ``nan`` is no name either."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def _finite(number: str, text: str) -> float:
    value = float(number) if _is_number(number) and number.isascii() and "_" not in number else math.nan
    if not abs(value) <= LARGEST:
        raise UsageError(f'--probe "{text}"', got=repr(number), expected="a finite number")
    return value
