"""Observations from outside: JSON lines in a file, or one JSON object on the bus."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from aerodft.adapters.file_kind import check_is_no_pipe
from aerodft.adapters.wire.payload import load_object, stamp_from
from aerodft.conventions import LARGEST
from aerodft.errors import InputError
from aerodft.model import Box, Observation, StampClock

_KEYS = frozenset((
    "schema", "name", "stamp_ns", "image", "pixels", "box", "contour", "unseen", "std_px", "clock", "arrival_ns",
    "source", "software",
))  # fmt: skip
_EXAMPLE = (
    '{"stamp_ns": "1795221278868833000", "name": "width-a", "pixels": [[812, 604.5], [1377, 611]], "std_px": 0.5}'
)
_MAX_LINE_BYTES = 1 << 20
_LIMITS: Final = 4
_LEAST_CORNERS: Final = 3
_MOST_CORNERS: Final = 4096
_MOST_LETTERS: Final = 200


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
    try:
        check_is_no_pipe(path)
        with path.open("rb") as lines:
            for number, line in enumerate(iter(lambda: lines.readline(_MAX_LINE_BYTES), b""), start=1):
                if line.strip():
                    where = f"{path}:{number}"
                    observations.append(_observation(_object(line, where), where, path.name, image_stamps_ns or {}))
    except OSError as error:
        raise InputError("the observation file cannot be read", where=path, got=error.strerror) from error
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
    payload = _object(data, source)
    if payload.setdefault("name", name) != name:
        raise InputError("the observation is of another probe", where=source, got=payload["name"], expected=name)
    return replace(_observation(payload, source, source, {}), arrival_ns=arrival_ns)


def _object(data: bytes, where: str) -> dict[str, Any]:
    payload = load_object(data, "the observation", where, _EXAMPLE)
    if unknown := sorted(payload.keys() - _KEYS):
        raise InputError("the observation has an unknown key", where=where, got=unknown[0], expected=_EXAMPLE)
    return payload


def _observation(payload: dict[str, Any], where: str, source: str, image_stamps_ns: Mapping[int, int]) -> Observation:
    name, image, clock = payload.get("name"), payload.get("image"), payload.get("clock", StampClock.UTC)
    if not isinstance(name, str) or not name:
        raise InputError("name is not the name of a probe", where=where, got=repr(name), expected=_EXAMPLE)
    if image is not None and (type(image) is not int or image < 0):
        raise InputError("image is no index", where=where, got=repr(image), expected="an integer from 0")
    if clock not in list(StampClock):
        raise InputError("clock is unknown", where=where, got=repr(clock), expected=" or ".join(StampClock))
    stamp_ns = _stamp_ns(payload.get("stamp_ns"), image, where, image_stamps_ns)
    stated = [key for key in ("pixels", "box", "contour") if payload.get(key) not in (None, [])] or ["pixels"]
    is_nothing = stated == ["pixels"] and payload.get("pixels") == []
    if len(stated) > 1:
        raise InputError(f"{stated[0]} beside {stated[1]}", where=where, expected="one of pixels, box and contour")
    return Observation(
        name=name,
        stamp_ns=stamp_ns,
        arrival_ns=stamp_ns,
        pixels=() if stated != ["pixels"] or is_nothing else _pixels(payload.get("pixels"), where),
        box=_box(payload["box"], where) if stated == ["box"] else None,
        contour=_contour(payload["contour"], where) if stated == ["contour"] else (),
        unseen=_unseen(payload.get("unseen"), where, is_nothing=is_nothing),
        std_px=_std_px(payload.get("std_px"), where),
        clock=StampClock(clock),
        image=image,
        source=source,
    )


def _stamp_ns(stamp: object, image: int | None, where: str, image_stamps_ns: Mapping[int, int]) -> int:
    if stamp is None and image is not None:
        if image not in image_stamps_ns:
            got = f"image {image} of {len(image_stamps_ns)} known"
            raise InputError("no stamp is known for the image", where=where, got=got, expected="stamp_ns")
        return image_stamps_ns[image]
    return stamp_from(stamp, where, "nanoseconds UTC as a decimal string")


def _pixels(value: object, where: str) -> tuple[tuple[float, float], ...]:
    if isinstance(value, list) and value and all(_is_pair(pair) for pair in value):
        return tuple((float(u), float(v)) for u, v in value)
    raise InputError("pixels are no pixels", where=where, got=repr(value)[:60], expected="[[u, v], ...], finite")


def _box(value: object, where: str) -> Box:
    if isinstance(value, list) and len(value) == _LIMITS and all(map(_is_finite, value)):
        left, top, right, bottom = map(float, value)
        if left < right and top < bottom:
            return left, top, right, bottom
    expected = "[left, top, right, bottom] in pixels, left < right and top < bottom"
    raise InputError("box is no box", where=where, got=repr(value)[:60], expected=expected)


def _contour(value: object, where: str) -> tuple[tuple[float, float], ...]:
    if isinstance(value, list) and _LEAST_CORNERS <= len(value) <= _MOST_CORNERS and all(map(_is_pair, value)):
        return tuple((float(u), float(v)) for u, v in value)
    got = f"{len(value)} corners" if isinstance(value, list) else repr(value)[:60]
    expected = f"[[u, v], ...], finite, {_LEAST_CORNERS} to {_MOST_CORNERS} of them"
    raise InputError("contour is no outline", where=where, got=got, expected=expected)


def _unseen(value: object, where: str, *, is_nothing: bool) -> str:
    if value is None:
        return ""
    if not is_nothing:
        raise InputError("unseen beside what was seen", where=where, expected='"pixels": [] beside it')
    if isinstance(value, str) and len(value) <= _MOST_LETTERS and value.isprintable():
        return value
    expected = f"a sentence of at most {_MOST_LETTERS} letters"
    raise InputError("unseen is no reason", where=where, got=repr(value)[:60], expected=expected)


def _is_pair(value: object) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(_is_finite, value))  # noqa: PLR2004 (u and v)


def _is_finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST


def _std_px(value: object, where: str) -> float | None:
    if value is None:
        return None
    if isinstance(value, int | float) and _is_finite(value) and value > 0:
        return float(value)
    raise InputError("std_px is no standard deviation", where=where, got=repr(value), expected="pixels above 0")
