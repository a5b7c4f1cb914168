"""JSON of others: what it holds, and that what would take too much is refused before it is read."""

import tracemalloc

import orjson
import pytest

from aerodft.adapters.wire.measurement import MEASUREMENTS_SCHEMA, split_measurements
from aerodft.adapters.wire.payload import MOST_JSON_BYTES, MOST_PICTURE_BYTES, load_bounded_json
from aerodft.errors import InputError


def test_it_reads_what_the_library_reads() -> None:
    text = orjson.dumps({"a": [1.5, None, "x, y"], "b": {"c": [True] * 1000}})
    assert load_bounded_json(text) == orjson.loads(text)
    with pytest.raises(orjson.JSONDecodeError):
        load_bounded_json(text[:-1])


@pytest.mark.parametrize("one", [b"[]", b"{}", b'{"a":{}}', b"1.5", b"12345678901", b'"\xf0\x9f\x9a\x81"'])
def test_no_text_takes_more_than_some_dozen_megabytes(one: bytes) -> None:
    """The longest text of each that is read; one value more, or one byte, is refused."""
    count = min(200_000, (MOST_JSON_BYTES - 2) // (len(one) + 1))
    text = b"[" + b",".join([one] * count) + b"]"
    tracemalloc.start()
    try:
        found = load_bounded_json(text)
        taken_mb = tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()
    assert len(found) == count
    assert taken_mb < 90
    with pytest.raises(orjson.JSONDecodeError, match="more than"):
        load_bounded_json(text[:-1] + b"," + one * 10 + b"," + one + b"]" + b" " * (MOST_JSON_BYTES - len(text)))


def test_an_image_as_text_may_be_longer() -> None:
    text = orjson.dumps("A" * (2 * MOST_JSON_BYTES))
    assert len(load_bounded_json(text, MOST_PICTURE_BYTES)) == 2 * MOST_JSON_BYTES
    with pytest.raises(orjson.JSONDecodeError, match="more than 4 MB"):
        load_bounded_json(text)


def test_what_measurements_share_is_not_written_out_for_too_many() -> None:
    """Each gets what they share: three megabytes and a thousand names would be three gigabytes."""

    def payload(shared_bytes: int, count: int) -> bytes:
        measured = [{"name": f"{k}"} for k in range(count)]
        return orjson.dumps({"schema": MEASUREMENTS_SCHEMA, "pose": "x" * shared_bytes, "measurements": measured})

    found = split_measurements(payload(1000, 2000))
    assert [orjson.loads(data)["name"] for _, data in found] == [f"{k}" for k in range(2000)]
    with pytest.raises(InputError, match="1000 measurements that share too much"):
        split_measurements(payload(3_000_000, 1000))
