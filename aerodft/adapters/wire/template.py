"""Payloads that differ in little: what stays is written once, the numbers of many in one go.

Their text is that of ``wire.dump``, byte by byte: the same writer makes it, of an array in place of many objects.
"""

import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Final

import numpy as np
import orjson

from aerodft.adapters.wire import payload as wire
from aerodft.adapters.wire.packed_bytes import JsonTemplate, PackedBytes
from aerodft.model import FloatArray, IntArray

# What stands for a hole; no name holds it.
_WHOLE, _NUMBER, _TEXT, _QUOTED = "\x00", "\x01", "\x02", "\x03"  # the last: a whole number's, in quotation marks
_HOLES: Final = re.compile(rb'"\\u000([012])"')
_TEXTS: Final = frozenset({"calibration", "reasons"})


def encode_payloads(
    kind: IntArray,
    payload: Callable[[int], wire.Json],
    whole: Mapping[str, IntArray],
    numbers: FloatArray,
    texts: Sequence[Sequence[str | tuple[str, ...] | None]] | None = None,
    fixed: Collection[str] = (),
) -> PackedBytes:
    """The texts of ``n`` payloads, each as ``wire.dump`` writes it alone.

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
    said = [b"\n".join(map(orjson.dumps, each)) for each in texts] if texts else [b""] * len(kind)
    unknown = np.isnan(numbers)
    key = np.concatenate([kind.astype("<i8").view(np.uint8), np.packbits(unknown, axis=1)], axis=1)
    rows_of: dict[bytes, list[int]] = {}
    for row, own_key in enumerate(key.view(f"V{key.shape[1]}").ravel().tolist()):
        rows_of.setdefault(own_key, []).append(row)
    parts: list[PackedBytes] = []
    for rows in rows_of.values():
        template = Template(payload(rows[0]), whole, fixed)
        known = numbers[rows][:, ~unknown[rows[0]]]
        if np.array_equal(template.numbers, known[0]):
            own_whole = np.stack([whole[name][rows] for name in template.whole], axis=-1)
            parts.append(template.texts(own_whole, known, b"\n".join([said[row] for row in rows])))
        else:  # a number of the first payload is a whole one, which JSON tells from others
            parts.append(PackedBytes.of([wire.dump(payload(row)) for row in rows]))
    if len(parts) == 1:
        return parts[0]
    return PackedBytes.joined(
        [PackedBytes.of([]), *parts], np.argsort([row for rows in rows_of.values() for row in rows])
    )


def flat(values: FloatArray) -> FloatArray:
    """Values ``(n, ...)`` as rows ``(n, m)``, also where there are none."""
    return values.reshape(len(values), math.prod(values.shape[1:]))


class Template:
    """The text of payloads with places for numbers and texts.

    Args:
        payload: One of them.
        whole: Keys whose values are whole numbers that differ, or texts of such.
        fixed: Keys, at any depth, whose numbers are the same in all of them.

    Attributes:
        whole: Those of the keys that have a value.
        numbers: The other numbers of the payload, without those that are no number.
    """

    def __init__(self, payload: wire.Json, whole: Collection[str], fixed: Collection[str] = ()) -> None:
        self.whole = [key for key in whole if payload[key] is not None]
        self.numbers: list[float] = []
        holes = {key: _QUOTED if isinstance(payload[key], str) else _WHOLE for key in self.whole}
        hollow = wire.dump({**self._hollow(payload, {*fixed, *_TEXTS}), **holes})
        text = hollow.replace(orjson.dumps(_QUOTED), b'"%b"' % orjson.dumps(_WHOLE))
        pieces = _HOLES.split(text)
        self._form = JsonTemplate.of(pieces[::2], [int(each) for each in pieces[1::2]])

    def texts(self, whole: IntArray, numbers: FloatArray, texts: bytes) -> PackedBytes:
        """Payloads with their whole numbers ``(n, k)``, other numbers ``(n, m)``, and texts, line by line."""
        first, then = (orjson.dumps(each.ravel(), option=orjson.OPT_SERIALIZE_NUMPY) for each in (whole, numbers))
        return self._form.filled((first[1:-1], then[1:-1], texts), b",,\n", len(whole))

    def _hollow(self, value: Any, kept: Collection[str]) -> Any:  # noqa: ANN401 - whatever JSON holds
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
