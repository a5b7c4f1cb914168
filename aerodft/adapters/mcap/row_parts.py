"""Messages that are gathered in any order, and put into the order in which they are written."""

from typing import NamedTuple

import numpy as np

from aerodft.adapters.mcap.channels import Channel
from aerodft.adapters.mcap.message_rows import MessageRows
from aerodft.adapters.texts import Texts
from aerodft.dft.answers import ImageAnswers
from aerodft.model.arrays import IntArray
from aerodft.model.pose_columns import Posed
from aerodft.model.telemetry import RawBlock

_Head = tuple[int, int, int, int, int]  # work, log time, order, channel, sequence
_Part = tuple[IntArray, Texts]  # heads (5, n) and payloads


class Record(NamedTuple):
    """One message to be written."""

    log_ns: int
    channel: Channel
    data: bytes
    sequence: int = 0


class RowParts:
    """Messages of some works: those of a work come in order of their log times, then as they were added.

    Attributes:
        poses: Those that are yet to be written.
        answers: Likewise.
    """

    def __init__(self) -> None:
        self.poses: list[Posed] = []
        self.answers: list[ImageAnswers] = []
        self._numbers: dict[int, int] = {}  # of channels, by identity
        self._channels: list[Channel] = []
        self._parts: list[_Part] = []
        self._texts: list[bytes] = []
        self._heads: tuple[list[_Head], list[_Head], list[_Head]] = ([], [], [])  # of texts, poses, answers
        self._count = 0

    def add(self, work: int, record: Record) -> None:
        """Add one of a work."""
        self._head(0, work, record.log_ns, record.channel, record.sequence)
        self._texts.append(record.data)

    def add_pose(self, work: int, log_ns: int, channel: Channel, posed: Posed) -> None:
        """Add one that is yet to be written."""
        self._head(1, work, log_ns, channel, 0)
        self.poses.append(posed)

    def add_answers(self, work: int, log_ns: int, channel: Channel, image: ImageAnswers) -> None:
        """Likewise."""
        self._head(2, work, log_ns, channel, 0)
        self.answers.append(image)

    def reserve(self, count: int) -> int:
        """Places in the order for so many; returns the first."""
        first, self._count = self._count + 1, self._count + count
        return first

    def add_texts(
        self,
        channel: Channel,
        works: IntArray,
        log_ns: IntArray,
        texts: Texts,
        *,
        order: IntArray | None = None,
        sequence: IntArray | None = None,
    ) -> None:
        """Add many of one channel.

        Args:
            channel: Theirs.
            works: ``(n,)`` of each.
            log_ns: ``(n,)``.
            texts: Payloads ``(n,)``.
            order: ``(n,)`` reserved places; None for those behind what was added before.
            sequence: ``(n,)``; None for 0.
        """
        count = len(texts)
        if not count:
            return
        heads = np.zeros((5, count), dtype=np.int64)
        heads[0], heads[1], heads[3] = works, log_ns, self._number(channel)
        heads[2] = np.arange(count) + self.reserve(count) if order is None else order
        if sequence is not None:
            heads[4] = sequence
        self._parts.append((heads, texts))

    def add_frames(self, channel: Channel, works: IntArray, block: RawBlock) -> None:
        """Add the frames of one sender, by their works ``(n,)``; before all others of the same time."""
        texts = Texts(block.data, block.offset, block.offset + block.length)
        self.add_texts(channel, works, block.arrival_ns, texts, order=np.zeros_like(works))

    def made(self, poses: Texts, answers: Texts) -> MessageRows:
        """All messages in their order, with what poses and answers come to."""
        listed = zip(self._heads, (Texts.of(self._texts), poses, answers), strict=True)
        parts = [(np.array(heads, dtype=np.int64).reshape(-1, 5).T, texts) for heads, texts in listed]
        parts = [*self._parts, *(part for part in parts if len(part[1]))]
        heads = np.concatenate([head for head, _ in parts] or [np.empty((5, 0), dtype=np.int64)], axis=1)
        order = np.lexsort((heads[2], heads[1], heads[0]))
        texts = Texts.joined([texts for _, texts in parts] or [Texts.of([])], order)
        _, log_ns, _, channel, sequence = heads[:, order]
        return MessageRows(tuple(self._channels), channel, log_ns, sequence, texts)

    def _head(self, part: int, work: int, log_ns: int, channel: Channel, sequence: int) -> None:
        self._count += 1
        self._heads[part].append((work, log_ns, self._count, self._number(channel), sequence))

    def _number(self, channel: Channel) -> int:
        number = self._numbers.get(id(channel))
        if number is None:
            number = self._numbers[id(channel)] = len(self._channels)
            self._channels.append(channel)
        return number
