"""Payloads that differ in numbers only: what stays is written once, the numbers of many of them in one go.

Their text is that of ``wire.dump``, byte by byte: the same writer makes it, of an array in place of many objects.
"""

import math
from collections.abc import Callable, Collection, Mapping
from typing import Any, Final

import numpy as np
import orjson

from aerodft.adapters.codec import wire
from aerodft.adapters.texts import Form, Texts
from aerodft.model.arrays import FloatArray, IntArray

_HOLE: Final = "\x00"  # no name or sentence holds it
_QUOTED: Final = "\x01"  # stands for a hole between quotation marks; no name or sentence holds it
_HOLE_TEXT: Final = orjson.dumps(_HOLE)


def encode_payloads(
    kind: IntArray,
    payload: Callable[[int], wire.Json],
    whole: Mapping[str, IntArray],
    numbers: FloatArray,
    fixed: Collection[str] = (),
) -> Texts:
    """The texts of ``n`` payloads, each as ``wire.dump`` writes it alone.

    Args:
        kind: ``(n, k)`` integers; payloads whose rows are equal differ in numbers only, and in which of them are None.
        payload: Makes one of them, by its row.
        whole: ``(n,)`` the integers, or texts of such, that differ, by the payload's keys and in their order; they
            stand before all other numbers. A payload that says None there has none.
        numbers: ``(n, m)`` the other numbers in the order in which they stand in a payload, NaN for None.
        fixed: Keys, at any depth, whose numbers are the same in all payloads of a kind.
    """
    unknown = np.isnan(numbers)
    key = np.concatenate([kind.astype("<i8").view(np.uint8), np.packbits(unknown, axis=1)], axis=1)
    rows_of: dict[bytes, list[int]] = {}
    for row, own_key in enumerate(key.view(f"V{key.shape[1]}").ravel().tolist()):
        rows_of.setdefault(own_key, []).append(row)
    parts: list[Texts] = []
    for rows in rows_of.values():
        template = Template(payload(rows[0]), whole, fixed)
        known = numbers[rows][:, ~unknown[rows[0]]]
        if np.array_equal(template.numbers, known[0]):
            own_whole = np.stack([whole[name][rows] for name in template.whole], axis=-1)
            parts.append(template.texts(own_whole, known))
        else:  # a number of the first payload is a whole one, which JSON tells from others
            parts.append(Texts.of([wire.dump(payload(row)) for row in rows]))
    if len(parts) == 1:
        return parts[0]
    return Texts.joined([Texts.of([]), *parts], np.argsort([row for rows in rows_of.values() for row in rows]))


def flat(values: FloatArray) -> FloatArray:
    """Values ``(n, ...)`` as rows ``(n, m)``, also where there are none."""
    return values.reshape(len(values), math.prod(values.shape[1:]))


class Template:
    """The text of payloads with places for whole numbers and, behind these, for others.

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
        holes = {key: _QUOTED if isinstance(payload[key], str) else _HOLE for key in self.whole}
        hollow = {key: holes.get(key) or self._hollow(value, fixed) for key, value in payload.items()}
        text = wire.dump(hollow).replace(orjson.dumps(_QUOTED), b'"%b"' % _HOLE_TEXT)
        self._form = Form.of(text.split(_HOLE_TEXT))

    def texts(self, whole: IntArray, numbers: FloatArray) -> Texts:
        """Payloads with their whole numbers ``(n, k)`` and others ``(n, m)``."""
        first, then = (orjson.dumps(each.ravel(), option=orjson.OPT_SERIALIZE_NUMPY) for each in (whole, numbers))
        return self._form.filled(first, then, *whole.shape)

    def _hollow(self, value: Any, fixed: Collection[str]) -> Any:  # noqa: ANN401 - whatever JSON holds
        """A value with holes for its numbers, which are noted in their order."""
        if isinstance(value, float):
            if math.isnan(value):
                return None
            self.numbers.append(value)
            return _HOLE
        if isinstance(value, dict):
            return {key: each if key in fixed else self._hollow(each, fixed) for key, each in value.items()}
        if isinstance(value, np.ndarray):
            value = value.tolist()
        return [self._hollow(each, fixed) for each in value] if isinstance(value, list | tuple) else value
