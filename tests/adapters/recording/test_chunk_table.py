"""A chunk's messages as columns: those of its records, whether few or many, also where it is damaged."""

import random
import struct
from itertools import chain, takewhile

import pytest

from aerodft.adapters.recording.read import messages as reading
from aerodft.adapters.recording.read import records_in
from aerodft.adapters.recording.read.messages import message_table, record_tables

MESSAGE, FEW = 5, 64
KNOWN = dict.fromkeys(range(40_000))


def record(dice: random.Random) -> bytes:
    opcode = dice.choice([3, 4, MESSAGE, MESSAGE, MESSAGE])
    content = dice.randbytes(dice.choice([22, 30, 300]))
    claimed = len(content) if dice.random() < 0.99 else dice.choice([0, 10, 10**4, 2**63, 2**64 - 1])
    return struct.pack("<BQ", opcode, claimed) + content


def test_zeros_are_no_records() -> None:
    """The format forbids opcode 0; a few kilobytes unpack to millions of these."""
    one = struct.pack("<BQ", MESSAGE, 22) + bytes(22)
    (table,) = record_tables(one + bytes(1 << 20))
    assert (table.opcode.tolist(), table.rest, table.is_damaged) == ([MESSAGE], None, True)
    with pytest.raises(ValueError, match="ends within a record"):
        list(records_in(one + bytes(1 << 20)))


def expected(data: bytes) -> list[tuple[int, int, int]]:
    """Opcode and place of each record, by the format's own words."""
    rows, at = [], 0
    while at + 9 <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, at)
        rows.append((opcode, at + 9, at + 9 + length))
        at += 9 + length
    return list(takewhile(lambda row: row[2] <= len(data) and (row[0] != MESSAGE or row[2] - row[1] >= 22), rows))


@pytest.mark.parametrize("most", [FEW, 1 << 16])
@pytest.mark.parametrize("count", [0, 1, FEW - 1, FEW, FEW + 1, 300])
def test_records_and_messages_are_those_of_the_format(count: int, most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "_MOST", most)
    dice = random.Random(count)  # noqa: S311 - damage, no secrets
    for turn in range(60):
        data = b"".join(record(dice) for _ in range(count))
        data = data[: dice.randrange(len(data) + 1)] if turn % 3 == 0 else data
        rows = expected(data)
        tables = list(record_tables(data))
        told = [row for each in tables for row in zip(each.opcode, each.start, each.stop, strict=True)]
        assert told == rows
        assert tables[-1].is_damaged == ((rows[-1][2] if rows else 0) < len(data))
        assert not any(each.is_damaged for each in tables[:-1])
        assert all(len(each.opcode) <= most for each in tables)
        found, are_known = zip(*[message_table(data, KNOWN, each) for each in tables], strict=True)
        heads = [
            (*struct.unpack_from("<HIQ", data, start), start, stop) for kind, start, stop in rows if kind == MESSAGE
        ]
        wanted = [(channel, log_ns, start + 22, stop) for channel, _, log_ns, start, stop in heads if channel in KNOWN]
        parts = (zip(each.channel, each.log_ns, each.start, each.stop, strict=True) for each in found)
        assert list(chain.from_iterable(parts)) == wanted
        assert all(are_known) == all(channel in KNOWN for channel, *_ in heads)


@pytest.mark.parametrize("share", [0.01, 0.9])
def test_a_few_messages_do_not_keep_a_large_chunk(share: float) -> None:
    payload = bytes(range(250)) * 4
    size = 6 << 20
    wanted = int(share * size) // len(payload)
    one = struct.pack("<BQHIQQ", MESSAGE, 22 + len(payload), 1, 0, 5, 5) + payload
    data = one * wanted + struct.pack("<BQ", 7, size - len(one) * wanted) + bytes(size - len(one) * wanted)
    (records,) = record_tables(data)
    table, _ = message_table(data, KNOWN, records)
    kept = table.kept()
    assert [kept.content[a:b] for a, b in zip(kept.start, kept.stop, strict=True)] == [payload] * wanted
    assert (kept.channel.tolist(), kept.log_ns.tolist()) == (table.channel.tolist(), table.log_ns.tolist())
    assert (len(kept.content) < size / 10) == (share < 0.1)
