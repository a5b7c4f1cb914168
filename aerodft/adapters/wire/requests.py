"""What others send: questions on the bus (measure these pixels, which probes are there, what was measured lately).

And observations: JSON lines in a file, or one JSON object on the bus.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Final, Self, TypeVar

import orjson
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from aerodft.adapters.config import (
    Elevations,
    ElevationStds,
    End,
    Many,
    Pixel,
    Positive,
    Real,
    Table,
    Text,
    impossible,
    validated,
)
from aerodft.adapters.files import check_is_no_pipe
from aerodft.adapters.wire.payload import COUNT, TEXT, Payload, StampNs, doc, load_object
from aerodft.dft import PROBE_KINDS, at_own_heights, probe_end
from aerodft.errors import InputError, Reason, UsageError, counted, located, os_errors_as
from aerodft.model import Box, KnownPoint, Observation, Probe, ProbeKind, StampClock

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
    pixels: Many[End]
    stamp_ns: StampNs | None = None
    std_px: Positive = 1.0
    elevation_m: Elevations = 0.0
    elevation_std_m: ElevationStds = 0.0

    @model_validator(mode="after")
    def _as_many_as_it_takes(self) -> Self:
        kind = PROBE_KINDS[ProbeKind(self.kind)]
        if not kind.takes_pixels(len(self.pixels)):
            expected = f"{kind.pixels_wanted} x [u, v] for {self.kind}"
            raise impossible("pixels", got=counted(len(self.pixels), "pixel"), expected=expected)
        is_surveyed = any(isinstance(end, str) for end in self.pixels)
        if not is_surveyed and (
            wrong := kind.wrong_elevations(self.elevation_m, self.elevation_std_m, len(self.pixels))
        ):
            expected = f"{kind.elevations_wanted(len(self.pixels))} of {self.kind}"
            raise impossible("elevation_m", got=wrong, expected=expected)
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


def parse_measure_request(data: bytes, points: Mapping[str, KnownPoint]) -> MeasureRequest:
    """Parse the payload of a ``measure`` query.

    Args:
        data: A JSON object.
        points: Surveyed points by name, whose heights count from the measured plane.

    Raises:
        InputError: It is no such question, or names an unknown point.
    """
    asked = _question(_MeasureQuestion, data, _WHERE, _EXAMPLE)
    kind = ProbeKind(asked.kind)
    try:
        ends = [probe_end(end, points) for end in asked.pixels]
        pixels, elevation_m, std_m = at_own_heights(kind, ends, asked.elevation_m, asked.elevation_std_m)
    except UsageError as error:
        raise InputError(f"pixels: {error.what}", where=_WHERE, got=error.got, expected=error.expected) from None
    probe = Probe(
        name=asked.name,
        kind=kind,
        pixels=pixels,
        std_px=asked.std_px,
        elevation_m=elevation_m,
        elevation_std_m=std_m,
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


_OBSERVATION_EXAMPLE = (
    '{"stamp_ns": "1795221278868833000", "name": "width-a", "pixels": [[812, 604.5], [1377, 611]], "std_px": 0.5}'
)
_MAX_LINE_BYTES = 1 << 20
_Contour = Annotated[tuple[Pixel, ...], Field(strict=False, min_length=3, max_length=4096)]


def _in_order(box: Box) -> Box:
    left, top, right, bottom = box
    if left >= right or top >= bottom:
        raise impossible("", got=list(box), expected="[left, top, right, bottom], left < right and top < bottom")
    return box


def _printable(sentence: str) -> str:
    if not sentence.isprintable():
        raise impossible("", got=repr(sentence), expected="a sentence in one line")
    return sentence


class ObservationTable(Table):
    """One observation as somebody else wrote it; what only recordings have is not looked at."""

    name: Text
    stamp_ns: StampNs | None = None
    image: Annotated[int, Field(ge=0)] | None = None
    pixels: Many[Pixel] | None = None
    box: Annotated[tuple[Real, Real, Real, Real], Field(strict=False), AfterValidator(_in_order)] | None = None
    contour: Annotated[_Contour | None, BeforeValidator(lambda corners: corners or None)] = None
    unseen: Annotated[str, Field(max_length=200), AfterValidator(_printable)] | None = None
    std_px: Positive | None = None
    clock: Annotated[StampClock, Field(strict=False)] = StampClock.UTC
    recorded_schema: Annotated[Any, Field(alias="schema")] = None
    arrival_ns: Any = None
    source: Any = None
    software: Any = None

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        stated = [key for key in ("pixels", "box", "contour") if getattr(self, key)]
        if len(stated) > 1:
            raise impossible(
                stated[0], got=Reason(f"it stands beside {stated[1]}"), expected="one of pixels, box and contour"
            )
        if not stated and self.pixels is None:
            raise impossible("pixels", got="nothing", expected="[[u, v], ...], or [] where nothing was seen")
        if self.unseen is not None and stated:
            raise impossible("unseen", got=Reason("it stands beside what was seen"), expected='"pixels": [] beside it')
        if self.stamp_ns is None and self.image is None:
            raise impossible("stamp_ns", got="nothing", expected="nanoseconds UTC as a decimal string, or image")
        return self


class ObservationList:
    """Observations in memory as a ``Source``, sorted by arrival."""

    def __init__(self, observations: Iterable[Observation]) -> None:
        self._observations = sorted(observations, key=lambda seen: (seen.arrival_ns, seen.name))

    def __len__(self) -> int:
        return len(self._observations)

    def events(self) -> Iterator[Observation]:
        """All observations, arrivals not decreasing."""
        return iter(self._observations)


def load_observations(path: Path, image_stamps_ns: Mapping[int, int] | None = None) -> ObservationList:
    """Read a JSON-lines file of observations.

    Each line has ``name``, ``pixels`` (``[[u, v], ...]``) or instead an object's ``box`` (``[left, top, right,
    bottom]``) or ``contour`` (``[[u, v], ...]``), ``stamp_ns`` (decimal string or integer, UTC) or ``image`` (an
    image's index), and if known ``std_px``. No pixels (``[]``) say that it was looked for and not seen, ``unseen`` in a
    sentence why. Blank lines are skipped. The arrival is the stamp.

    Args:
        path: The file.
        image_stamps_ns: Stamps of the images by index, for lines that name an image alone.

    Raises:
        InputError: The file cannot be read, or a line is wrong; names the line.
    """
    observations: list[Observation] = []
    with os_errors_as("the observation file cannot be read", where=path):
        check_is_no_pipe(path)
        with path.open("rb") as lines:
            for number, line in enumerate(iter(lambda: lines.readline(_MAX_LINE_BYTES), b""), start=1):
                if line.strip():
                    observations.append(_observation(line, f"{path}:{number}", path.name, image_stamps_ns or {}))
    return ObservationList(observations)


def parse_observation(data: bytes, *, name: str, arrival_ns: int, source: str) -> Observation:
    """Parse one observation from the bus.

    Args:
        data: A JSON object as in a file's line; its ``name`` may be left out.
        name: The probe that its key expression names.
        arrival_ns: When it came.
        source: The key expression.

    Raises:
        InputError: It is no observation, or of another probe than its key says.
    """
    seen = _observation(data, source, source, {}, name=name)
    if seen.name != name:
        raise InputError("the observation is of another probe", where=source, got=seen.name, expected=name)
    return replace(seen, arrival_ns=arrival_ns)


def _observation(data: bytes, where: str, source: str, image_stamps_ns: Mapping[int, int], **known: str) -> Observation:
    payload = known | load_object(data, "the observation", where, _OBSERVATION_EXAMPLE)
    with located(where):
        table = validated(ObservationTable, payload)
        stamp_ns = table.stamp_ns
        if stamp_ns is None and table.image is not None:
            stamp_ns = image_stamps_ns.get(table.image)
        if stamp_ns is None:
            got = f"image {table.image} of {len(image_stamps_ns)} known"
            raise InputError("no stamp is known for the image", got=got, expected="stamp_ns")
    return Observation(
        name=table.name,
        stamp_ns=stamp_ns,
        arrival_ns=stamp_ns,
        pixels=table.pixels or (),
        box=table.box,
        contour=table.contour or (),
        unseen=table.unseen or "",
        std_px=table.std_px,
        clock=table.clock,
        image=table.image,
        source=source,
    )
