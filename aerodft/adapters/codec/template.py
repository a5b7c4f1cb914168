"""Payloads that differ in numbers only: what stays is written once, the numbers of many of them in one go.

Their text is that of ``wire.dump``, byte by byte: the same writer makes it, of an array in place of many objects.
"""

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import numpy as np
import orjson

from aerodft.adapters.codec import wire
from aerodft.adapters.texts import Form, Texts
from aerodft.model.arrays import FloatArray

_HOLE: Final = "\x00"  # no name or sentence holds it
_HOLE_TEXT: Final = orjson.dumps(_HOLE)
_FEWEST: Final = 4  # payloads for which a template is worth its making
_MOST_TEMPLATES: Final = 64

T = TypeVar("T")
Words = tuple[bytes, ...]
Numbers = Callable[[Sequence[T]], FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class Same:
    """A part of a key: equal to itself alone, and quicker to look at than all that it holds."""

    value: object

    def __hash__(self) -> int:
        return id(self.value)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and other.value is self.value


class Template:
    """The text of payloads with places for words and, behind these, for numbers.

    Args:
        payload: One of them.
        words: Keys whose values are words.
        fixed: Keys, at any depth, whose numbers are the same in all of them.
    """

    def __init__(self, payload: wire.Json, words: Sequence[str], fixed: frozenset[str]) -> None:
        self.numbers: list[float] = []
        hollow = {key: _HOLE if key in words else self._hollow(value, fixed) for key, value in payload.items()}
        self._form = Form.of(wire.dump(hollow).split(_HOLE_TEXT))

    def texts(self, words: Sequence[Words], numbers: FloatArray) -> Texts:
        """Payloads with their words and numbers ``(n, m)``."""
        flat = orjson.dumps(numbers.ravel(), option=orjson.OPT_SERIALIZE_NUMPY)
        each = b",".join(word for own in words for word in own)
        return self._form.filled(each, flat[1:-1], len(words), len(words[0]))

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


class Templates:
    """Templates by what their payloads have in common.

    Args:
        words: As in ``Template``.
        fixed: Likewise.
    """

    def __init__(self, words: Sequence[str], fixed: Iterable[str] = ()) -> None:
        self._words = words
        self._fixed = frozenset(fixed)
        self._known: dict[Hashable, Template | None] = {}

    def written(
        self,
        items: Sequence[T],
        key: Callable[[T], Hashable | None],
        payload: Callable[[T], wire.Json],
        words: Callable[[T], Words],
        numbers: Numbers[T],
    ) -> Texts:
        """The payloads of items, each as if it was written alone.

        Args:
            items: What to write.
            key: What an item's payload is alike with others' by; None for one that is like no other.
            payload: Of one item.
            words: Of one item, as JSON without commas.
            numbers: Of some that are alike, ``(n, m)``.
        """
        alike: dict[Hashable, list[int]] = {}
        for row, item in enumerate(items):
            alike.setdefault(key(item), []).append(row)
        parts: list[Texts] = []
        for common, rows in alike.items():
            own = [items[row] for row in rows]
            template = None
            if common is not None and len(rows) >= _FEWEST:
                values = numbers(own)
                template = self._template(common, own[0], payload, values[0])
            if template is None:
                parts.append(Texts.of([wire.dump(payload(item)) for item in own]))
            else:
                parts.append(template.texts(list(map(words, own)), values))
        rows = [row for own in alike.values() for row in own]
        return Texts.joined(parts, np.argsort(rows)) if parts else Texts.of([])

    def _template(
        self, common: Hashable, item: T, payload: Callable[[T], wire.Json], numbers: FloatArray
    ) -> Template | None:
        """The template of what is alike; None where an item's payload has other numbers than these (a whole one)."""
        if common not in self._known:
            if len(self._known) >= _MOST_TEMPLATES:
                self._known.clear()
            template = Template(payload(item), self._words, self._fixed)
            is_right = np.array_equal(template.numbers, numbers, equal_nan=True)
            self._known[common] = template if is_right else None
        return self._known[common]
