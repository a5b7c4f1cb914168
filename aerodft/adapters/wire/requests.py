"""Questions on the bus: measure these pixels; which probes are there; what was measured lately."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import orjson

from aerodft.adapters.wire.payload import dump_payload, load_object, pixel_pairs, stamp_from
from aerodft.conventions import LARGEST
from aerodft.dft import PROBE_KINDS, Kind
from aerodft.errors import InputError
from aerodft.model import Probe, ProbeKind
from aerodft.version import SOFTWARE

ERROR_SCHEMA = "aerodft.error/1"

_WHERE = "measure"
_KEYS = frozenset({"name", "kind", "pixels", "stamp_ns", "std_px", "elevation_m"})
_EXAMPLE = '{"kind": "distance", "pixels": [[812, 604.5], [1377, 611]]}'
_HISTORY_EXAMPLE = '{"last": 10, "name": "width"}'
_HISTORY_KEYS = frozenset({"last", "name"})
_MAX_HISTORY = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasureRequest:
    """A question for one measurement.

    Attributes:
        probe: What to measure, with its pixels.
        stamp_ns: At which stamp (UTC); None for the newest pose.
    """

    probe: Probe
    stamp_ns: int | None = None


def parse_measure_request(data: bytes) -> MeasureRequest:
    """Parse the payload of a ``measure`` query.

    Raises:
        InputError: It is no such question.
    """
    payload = load_object(data, "the question", _WHERE, _EXAMPLE)
    if unknown := sorted(payload.keys() - _KEYS):
        raise InputError("unknown key", where=_WHERE, got=unknown[0], expected=", ".join(sorted(_KEYS)))
    asked = payload.get("kind")
    kind = PROBE_KINDS.get(ProbeKind(asked)) if isinstance(asked, str) else None
    if kind is None:
        raise InputError("kind is unknown", where=_WHERE, got=repr(asked), expected=", ".join(PROBE_KINDS))
    name = payload.get("name", _WHERE)
    if not isinstance(name, str) or not name:
        raise InputError("name is no name", where=_WHERE, got=repr(name), expected="text")
    stamp_ns = payload.get("stamp_ns")
    if stamp_ns is not None:
        stamp_ns = stamp_from(stamp_ns, _WHERE, "a decimal string")
    std_px = _real(payload, "std_px", 1.0)
    if std_px <= 0:
        raise InputError("std_px is no standard deviation", where=_WHERE, got=std_px, expected="pixels above 0")
    probe = Probe(
        name=name,
        kind=kind.name,
        pixels=_pixels(payload.get("pixels"), kind),
        std_px=std_px,
        elevation_m=_real(payload, "elevation_m", 0.0),
    )
    return MeasureRequest(probe=probe, stamp_ns=stamp_ns)


def parse_history_request(data: bytes) -> tuple[int, str | None]:
    """Parse the payload of a ``history`` query: at most how many measurements, and of which probe (None for all).

    Raises:
        InputError: It is no such question.
    """
    if not data.strip():
        return _MAX_HISTORY, None
    payload = load_object(data, "the question", "history", _HISTORY_EXAMPLE)
    if unknown := sorted(payload.keys() - _HISTORY_KEYS):
        raise InputError("unknown key", where="history", got=unknown[0], expected=", ".join(sorted(_HISTORY_KEYS)))
    last, name = payload.get("last", _MAX_HISTORY), payload.get("name")
    if type(last) is not int or last < 0:
        raise InputError("last is no count", where="history", got=repr(last), expected="an integer from 0")
    if name is not None and not isinstance(name, str):
        raise InputError("name is no probe", where="history", got=repr(name), expected="text")
    return last, name


def encode_probes(probes: Iterable[Probe]) -> bytes:
    """The answer to a ``probes`` query."""
    return orjson.dumps(
        [
            {
                "name": probe.name,
                "kind": probe.kind,
                "source": probe.source,
                "pixels": probe.pixels,
                "std_px": probe.std_px,
                "elevation_m": probe.elevation_m,
                "elevation_std_m": probe.elevation_std_m,
                "on_top_of": probe.on_top_of,
            }
            for probe in probes
        ]
    )


def encode_error(code: int, sentence: str) -> bytes:
    """``aerodft.error/1``, the error reply to a question that has no answer.

    Args:
        code: What a command that fails so would exit with.
        sentence: What is wrong.
    """
    return dump_payload({"schema": ERROR_SCHEMA, "code": code, "sentence": sentence, "software": SOFTWARE})


def _pixels(value: object, kind: Kind) -> tuple[tuple[float, float], ...]:
    try:
        pixels = pixel_pairs(value)  # type: ignore[arg-type]  # what JSON has is checked by taking it apart
    except (TypeError, ValueError):
        pixels = ()
    if not kind.takes_pixels(len(pixels)) or not all(abs(u) <= LARGEST and abs(v) <= LARGEST for u, v in pixels):
        raise InputError(
            "wrong pixels", where=_WHERE, got=repr(value)[:60], expected=f"{kind.pixels_wanted} x [u, v], finite"
        )
    return pixels


def _real(payload: dict[str, Any], key: str, default: float) -> float:
    value = payload.get(key)
    if value is None:
        return default
    if type(value) not in {int, float} or not abs(value) <= LARGEST:
        raise InputError(f"{key} is no number", where=_WHERE, got=repr(value), expected="a finite number")
    return float(value)
