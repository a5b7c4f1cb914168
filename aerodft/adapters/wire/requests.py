"""Questions on the bus: measure these pixels; which probes are there; what was measured lately."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Final, Self, TypeVar

import orjson
from pydantic import AfterValidator, Field, model_validator

from aerodft.adapters.config import Many, Pixel, Positive, Real, Table, Text, impossible, validated
from aerodft.adapters.wire.payload import COUNT, TEXT, Payload, StampNs, doc, load_object
from aerodft.dft import PROBE_KINDS
from aerodft.errors import located
from aerodft.model import Probe, ProbeKind

ERROR_SCHEMA = "aerodft.error/1"

ERROR: Final = Payload(
    ERROR_SCHEMA,
    "The error reply to a query that has no answer",
    {
        "code": doc(COUNT, "As commands exit: 3 the question or an input is wrong, 4 no answer, 1 a bug"),
        "sentence": doc(TEXT, "What is wrong: where, got, expected, what to do"),
    },
)

_WHERE = "measure"
_EXAMPLE = '{"kind": "distance", "pixels": [[812, 604.5], [1377, 611]]}'
_HISTORY_EXAMPLE = '{"last": 10, "name": "width"}'
_PROBE_KEYS = ("name", "kind", "source", "pixels", "std_px", "elevation_m", "elevation_std_m", "on_top_of")

TableT = TypeVar("TableT", bound=Table)


def _kind(name: str) -> str:
    if ProbeKind(name) not in PROBE_KINDS:
        raise impossible("", got=f'"{name}"', expected=f"one of {', '.join(PROBE_KINDS)}")
    return name


class _MeasureQuestion(Table):
    name: Text = _WHERE
    kind: Annotated[str, AfterValidator(_kind)]
    pixels: Many[Pixel]
    stamp_ns: StampNs | None = None
    std_px: Positive = 1.0
    elevation_m: Real = 0.0

    @model_validator(mode="after")
    def _as_many_as_it_takes(self) -> Self:
        kind = PROBE_KINDS[ProbeKind(self.kind)]
        if not kind.takes_pixels(len(self.pixels)):
            expected = f"{kind.pixels_wanted} x [u, v] for {self.kind}"
            raise impossible("pixels", got=f"{len(self.pixels)} of them", expected=expected)
        return self


class _HistoryQuestion(Table):
    last: Annotated[int, Field(ge=0)] = 1_000_000
    name: str | None = None


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
    asked = _question(_MeasureQuestion, data, _WHERE, _EXAMPLE)
    probe = Probe(
        name=asked.name,
        kind=ProbeKind(asked.kind),
        pixels=asked.pixels,
        std_px=asked.std_px,
        elevation_m=asked.elevation_m,
    )
    return MeasureRequest(probe=probe, stamp_ns=asked.stamp_ns)


def parse_history_request(data: bytes) -> tuple[int, str | None]:
    """Parse the payload of a ``history`` query: at most how many measurements, and of which probe (None for all).

    Raises:
        InputError: It is no such question.
    """
    asked = _question(_HistoryQuestion, data if data.strip() else b"{}", "history", _HISTORY_EXAMPLE)
    return asked.last, asked.name


def _question(model: type[TableT], data: bytes, where: str, example: str) -> TableT:
    """A question's table; keys that are null count as left out."""
    payload = load_object(data, "the question", where, example)
    with located(where):
        return validated(model, {key: value for key, value in payload.items() if value is not None})


def encode_probes(probes: Iterable[Probe]) -> bytes:
    """The answer to a ``probes`` query."""
    return orjson.dumps([{key: getattr(probe, key) for key in _PROBE_KEYS} for probe in probes])


def encode_error(code: int, sentence: str) -> bytes:
    """``aerodft.error/1``, the error reply to a question that has no answer.

    Args:
        code: What a command that fails so would exit with.
        sentence: What is wrong.
    """
    return ERROR.dump(None, code=code, sentence=sentence)
