"""Many payloads in one piece of memory: what they share is written once, the numbers of many in one go.

Their text is that of ``dump_payload``, byte by byte: orjson writes it, of an array in place of many objects.
"""

import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import orjson

from aerodft.adapters.wire.payload import Json, JsonValue, dump_payload
from aerodft.jit import njit
from aerodft.model import FloatArray, ImageArray, IntArray

# What stands for a hole; no name holds it.
_WHOLE, _NUMBER, _TEXT, _QUOTED = "\x00", "\x01", "\x02", "\x03"  # the last: a whole number's, in quotation marks
_HOLES: Final = re.compile(rb'"\\u000([012])"')
_TEXTS: Final = frozenset({"calibration", "reasons"})
_SEPARATORS: Final = b",,\n"  # of whole numbers, other numbers and texts
_ONE = np.uint64(1)


@dataclass(frozen=True, slots=True, eq=False)
class PackedBytes:
    """``n`` texts; memory may hold more than these.

    Attributes:
        data: All of them.
        start: ``(n,)`` where each begins.
        stop: ``(n,)`` where it ends.
    """

    data: bytes | memoryview
    start: IntArray
    stop: IntArray

    @staticmethod
    def from_texts(texts: Sequence[bytes]) -> "PackedBytes":
        """Texts one behind the other."""
        stop = np.cumsum(np.fromiter(map(len, texts), dtype=np.int64, count=len(texts)))
        return PackedBytes(b"".join(texts), np.concatenate([[0], stop[:-1]])[: len(stop)], stop)

    @staticmethod
    def concatenated(parts: "Sequence[PackedBytes]", order: IntArray) -> "PackedBytes":
        """The texts of all parts, put into an order: ``(n,)`` numbers, counted part after part."""
        ahead = np.cumsum([0, *(len(part.data) for part in parts)])
        start = np.concatenate([part.start + by for part, by in zip(parts, ahead[:-1], strict=True)])
        stop = np.concatenate([part.stop + by for part, by in zip(parts, ahead[:-1], strict=True)])
        return PackedBytes(b"".join(part.data for part in parts), start[order], stop[order])

    def __len__(self) -> int:
        return len(self.start)

    def each(self) -> list[bytes]:
        """The texts."""
        return [self.text(row) for row in range(len(self))]

    def text(self, row: int) -> bytes:
        """One of the texts."""
        return bytes(self.data[self.start[row] : self.stop[row]])


def encode_payloads(
    kind: IntArray,
    payload: Callable[[int], Json],
    whole: Mapping[str, IntArray],
    numbers: FloatArray,
    texts: Sequence[Sequence[str | tuple[str, ...] | None]] | None = None,
    fixed: Collection[str] = (),
) -> PackedBytes:
    """The texts of ``n`` payloads, each as ``dump_payload`` writes it alone.

    Args:
        kind: ``(n, k)`` integers; payloads whose rows are equal differ only in texts, in numbers, and in which of the
            numbers are None.
        payload: Makes one of them, by its row.
        whole: ``(n,)`` the integers, or texts of such, that differ, by the payload's keys and in their order; they
            stand before all other numbers. A payload that says None there has none.
        numbers: ``(n, m)`` the other numbers in the order in which they stand in a payload, NaN for None.
        texts: Of each payload what its keys ``calibration`` and ``reasons``, at any depth, hold one after the other;
            None without such keys.
        fixed: Keys, at any depth, whose numbers are the same in all payloads of a kind.
    """
    if not len(kind):
        return PackedBytes.from_texts([])
    said = [b"\n".join(map(orjson.dumps, each)) for each in texts] if texts else [b""] * len(kind)
    unknown = np.isnan(numbers)
    key = np.concatenate([kind.astype("<i8").view(np.uint8), np.packbits(unknown, axis=1)], axis=1)
    ends = np.flatnonzero(np.any(key[1:] != key[:-1], axis=1)) + 1
    runs_of: dict[bytes, list[IntArray]] = {}
    for run in np.split(np.arange(len(key)), ends):
        runs_of.setdefault(key[run[0]].tobytes(), []).append(run)
    groups = [np.concatenate(runs) for runs in runs_of.values()]
    parts: list[PackedBytes] = []
    for rows in groups:
        template = JsonTemplate(payload(int(rows[0])), whole, fixed)
        known = numbers[np.ix_(rows, ~unknown[rows[0]])]
        if np.array_equal(template.numbers, known[0]):
            own_whole = np.stack([whole[name][rows] for name in template.whole], axis=-1)
            parts.append(template.fill(own_whole, known, b"\n".join([said[row] for row in rows.tolist()])))
        else:  # a number of the first payload is a whole one, which JSON tells from others
            parts.append(PackedBytes.from_texts([dump_payload(payload(row)) for row in rows.tolist()]))
    return parts[0] if len(parts) == 1 else PackedBytes.concatenated(parts, np.argsort(np.concatenate(groups)))


def flat(values: FloatArray) -> FloatArray:
    """Values ``(n, ...)`` as rows ``(n, m)``, also where there are none."""
    return values.reshape(len(values), math.prod(values.shape[1:]))


class JsonTemplate:
    """The text of payloads with holes for numbers and texts.

    Args:
        payload: One of them.
        whole: Keys whose values are whole numbers that differ, or texts of such.
        fixed: Keys, at any depth, whose numbers are the same in all of them.

    Attributes:
        whole: Those of the keys that have a value.
        numbers: The other numbers of the payload, without those that are no number.
    """

    def __init__(self, payload: Json, whole: Collection[str], fixed: Collection[str] = ()) -> None:
        self.whole = [key for key in whole if payload[key] is not None]
        self.numbers: list[float] = []
        holes = {key: _QUOTED if isinstance(payload[key], str) else _WHOLE for key in self.whole}
        hollow = dump_payload({**self._hollow(payload, {*fixed, *_TEXTS}), **holes})
        text = hollow.replace(orjson.dumps(_QUOTED), b'"%b"' % orjson.dumps(_WHOLE))
        pieces = _HOLES.split(text)
        between = PackedBytes.from_texts(pieces[::2])
        self._pieces, self._ends = np.frombuffer(between.data, dtype=np.uint8), between.stop
        self._sources = np.array([int(each) for each in pieces[1::2]], dtype=np.int64)

    def fill(self, whole: IntArray, numbers: FloatArray, texts: bytes) -> PackedBytes:
        """``n`` payloads of their whole numbers ``(n, k)``, other numbers ``(n, m)``, and texts, line by line."""
        first, then = (orjson.dumps(each.ravel(), option=orjson.OPT_SERIALIZE_NUMPY) for each in (whole, numbers))
        sources = tuple(np.frombuffer(each, dtype=np.uint8) for each in (first[1:-1], then[1:-1], texts))
        count = len(whole)
        out = np.empty(count * len(self._pieces) + sum(map(len, sources)), dtype=np.uint8)
        stop = np.empty(count, dtype=np.int64)
        _fill(self._pieces, self._ends, self._sources, sources, np.frombuffer(_SEPARATORS, dtype=np.uint8), out, stop)
        used = int(stop[-1]) if count else 0
        return PackedBytes(out[:used].data, np.concatenate([[0], stop[:-1]])[:count], stop)

    def _hollow(self, value: JsonValue, kept: Collection[str]) -> JsonValue:
        """A value with holes for texts and for numbers, which are noted in their order; ``kept`` keys stay."""
        if isinstance(value, float):
            if math.isnan(value):
                return None
            self.numbers.append(value)
            return _NUMBER
        if isinstance(value, dict):
            hollow = {key: each if key in kept else self._hollow(each, kept) for key, each in value.items()}
            return hollow | dict.fromkeys(_TEXTS & value.keys(), _TEXT)
        if isinstance(value, np.ndarray):
            value = value.tolist()
        return [self._hollow(each, kept) for each in value] if isinstance(value, list | tuple) else value


@njit
def _fill(
    pieces: ImageArray,
    ends: IntArray,
    source_of: IntArray,
    sources: tuple[ImageArray, ...],
    separators: ImageArray,
    out: ImageArray,
    stop: IntArray,
) -> None:
    """Positions are unsigned: the compiler looks at signed ones for being counted from the end, byte by byte."""
    at = np.zeros(len(sources), dtype=np.uint64)
    position = np.uint64(0)
    for row in range(len(stop)):
        begin = np.uint64(0)
        for hole in range(len(ends)):
            end = np.uint64(ends[hole])
            while begin < end:
                out[position] = pieces[begin]
                begin += _ONE
                position += _ONE
            if hole < len(source_of):
                own = source_of[hole]
                position, at[own] = _put(sources[own], separators[own], at[own], out, position)
        stop[row] = position


@njit
def _put(
    source: ImageArray, separator: np.uint8, at: np.uint64, out: ImageArray, position: np.uint64
) -> tuple[np.uint64, np.uint64]:
    """Copy up to the next separator; gives back what is behind."""
    end = np.uint64(len(source))
    while at < end and source[at] != separator:
        out[position] = source[at]
        at += _ONE
        position += _ONE
    return position, at + _ONE
