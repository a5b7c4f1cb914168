"""Payloads that differ in numbers only: what stays is written once, the numbers of many of them in one go.

Their text is that of ``wire.dump``, byte by byte: the same writer makes it, of an array in place of many objects.
"""

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np
import orjson

from aerodft.adapters.codec import wire
from aerodft.adapters.texts import Form, Texts
from aerodft.model.arrays import FloatArray, IntArray

_HOLE: Final = "\x00"  # no name or sentence holds it
_QUOTED: Final = "\x01"  # likewise
_HOLE_TEXT: Final = orjson.dumps(_HOLE)
_FEWEST: Final = 4  # payloads for which a template is worth its making
_MOST_TEMPLATES: Final = 64

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class Same:
    """A part of a key: equal to itself alone, and quicker to look at than all that it holds."""

    value: object

    def __hash__(self) -> int:
        return id(self.value)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and other.value is self.value


class Alike(NamedTuple):
    """Some of many payloads, ``n`` of them, that differ in whole numbers and in numbers only.

    Attributes:
        rows: ``(n,)`` which of all payloads.
        key: What they have in common; None where they are like no other.
        payload: One of them, counted from 0.
        whole: ``(n, k)`` the whole numbers that differ: those that a payload has by its keys of ``Templates.whole``.
        numbers: ``(n, m)`` the others, in the order in which they stand in a payload.
    """

    rows: IntArray
    key: Hashable | None
    payload: Callable[[int], wire.Json]
    whole: Callable[[], IntArray]
    numbers: Callable[[], FloatArray]


class Template:
    """The text of payloads with places for whole numbers and, behind these, for others.

    Args:
        payload: One of them.
        whole: Keys whose values are whole numbers that differ, or texts of such.
        fixed: Keys, at any depth, whose numbers are the same in all of them.
    """

    def __init__(self, payload: wire.Json, whole: Sequence[str], fixed: frozenset[str]) -> None:
        self.numbers: list[float] = []
        hollow = {key: _hole(value) if key in whole else self._hollow(value, fixed) for key, value in payload.items()}
        text = wire.dump(hollow).replace(orjson.dumps(_QUOTED), b'"%b"' % _HOLE_TEXT)
        self._form = Form.of(text.split(_HOLE_TEXT))

    def texts(self, whole: IntArray, numbers: FloatArray) -> Texts:
        """Payloads with their whole numbers ``(n, k)`` and others ``(n, m)``."""
        first, then = (orjson.dumps(each.ravel(), option=orjson.OPT_SERIALIZE_NUMPY) for each in (whole, numbers))
        return self._form.filled(first, then, *whole.shape)

    def _hollow(self, value: Any, fixed: frozenset[str]) -> Any:  # noqa: ANN401 - whatever JSON holds
        """A value with holes for its numbers, which are noted in their order."""
        if isinstance(value, float):
            self.numbers.append(value)
            return _HOLE
        if isinstance(value, dict):
            return {key: each if key in fixed else self._hollow(each, fixed) for key, each in value.items()}
        if isinstance(value, np.ndarray):
            value = value.tolist()
        return [self._hollow(each, fixed) for each in value] if isinstance(value, list | tuple) else value


def _hole(value: str | int | None) -> str | None:
    if value is None:
        return None
    return _QUOTED if isinstance(value, str) else _HOLE


class Templates:
    """Templates by what their payloads have in common.

    Args:
        whole: As in ``Template``.
        fixed: Likewise.
    """

    def __init__(self, whole: Sequence[str], fixed: Iterable[str] = ()) -> None:
        self._whole = whole
        self._fixed = frozenset(fixed)
        self._known: dict[Hashable, Template | None] = {}

    def written(
        self,
        items: Sequence[T],
        key: Callable[[T], Hashable | None],
        payload: Callable[[T], wire.Json],
        whole: Callable[[Sequence[T]], IntArray],
        numbers: Callable[[Sequence[T]], FloatArray],
    ) -> Texts:
        """The payloads of items, each as if it was written alone; arguments are as in ``Alike``, of items."""
        rows_of: dict[Hashable, list[int]] = {}
        for row, item in enumerate(items):
            rows_of.setdefault(key(item), []).append(row)

        def alike(common: Hashable, rows: list[int]) -> Alike:
            own = [items[row] for row in rows]
            return Alike(
                np.array(rows), common, lambda row: payload(own[row]), lambda: whole(own), lambda: numbers(own)
            )

        return self.joined([alike(common, rows) for common, rows in rows_of.items()])

    def joined(self, groups: Sequence[Alike]) -> Texts:
        """All payloads of some groups, in the order of their rows."""
        parts: list[Texts] = []
        for group in groups:
            template = None
            if group.key is not None and len(group.rows) >= _FEWEST:
                numbers = group.numbers()
                template = self._template(group, numbers[0])
            if template is None:
                parts.append(Texts.of([wire.dump(group.payload(row)) for row in range(len(group.rows))]))
            else:
                parts.append(template.texts(group.whole(), numbers))
        if len(parts) < 2:  # noqa: PLR2004 - one alone is in order
            return parts[0] if parts else Texts.of([])
        return Texts.joined(parts, np.argsort(np.concatenate([group.rows for group in groups])))

    def _template(self, group: Alike, numbers: FloatArray) -> Template | None:
        """The template of what is alike; None where an item's payload has other numbers than these (a whole one)."""
        if group.key not in self._known:
            if len(self._known) >= _MOST_TEMPLATES:
                self._known.clear()
            template = Template(group.payload(0), self._whole, self._fixed)
            is_right = np.array_equal(template.numbers, numbers, equal_nan=True)
            self._known[group.key] = template if is_right else None
        return self._known[group.key]
