"""Observation files: what is read, and what is refused, by line."""

from pathlib import Path

import orjson
import pytest

from aerodft.adapters.wire.events import encode_observation
from aerodft.adapters.wire.observations import load_observations, parse_observation
from aerodft.errors import InputError
from aerodft.model import StampClock
from tests.payloads import decode_observation

GOOD = {"stamp_ns": "1795221278868833000", "name": "width-a", "pixels": [[812, 604.5], [1377, 611]], "std_px": 0.5}
BARE = {"stamp_ns": "1795221278868833000", "name": "walker"}


def write(path: Path, *lines: object) -> Path:
    file = path / "seen.jsonl"
    file.write_bytes(b"\n".join(line if isinstance(line, bytes) else orjson.dumps(line) for line in lines))
    return file


def test_lines_are_read_sorted_with_stamps_as_numbers_or_strings(tmp_path: Path) -> None:
    file = write(tmp_path, GOOD, b"", b"  ", {**GOOD, "stamp_ns": 5, "std_px": None, "clock": "host"})
    got = list(load_observations(file).events())
    assert [seen.stamp_ns for seen in got] == [5, 1795221278868833000]
    assert [seen.arrival_ns for seen in got] == [5, 1795221278868833000]
    assert got[1].pixels == ((812.0, 604.5), (1377.0, 611.0))
    assert [seen.std_px for seen in got] == [None, 0.5]
    assert got[0].clock is StampClock.HOST
    assert got[0].source == "seen.jsonl"


def test_an_image_index_stands_for_its_stamp(tmp_path: Path) -> None:
    file = write(tmp_path, {"image": 7, "name": "a", "pixels": [[1, 2]]})
    (seen,) = load_observations(file, {7: 123}).events()
    assert (seen.stamp_ns, seen.image) == (123, 7)
    with pytest.raises(InputError, match=r"seen.jsonl:1: no stamp is known for the image"):
        load_observations(file, {8: 1})


def test_boxes_and_contours_come_as_they_are_and_stay_so_on_the_way_through_a_recording(tmp_path: Path) -> None:
    contour = [[1.5, 2.25], [3, 4], [0.1, 9]]
    file = write(tmp_path, {**BARE, "box": [1, 2.5, 3, 4]}, {**BARE, "contour": contour, "pixels": []})
    box, outline = load_observations(file).events()
    assert (box.box, box.contour, box.pixels) == ((1.0, 2.5, 3.0, 4.0), (), ())
    assert (outline.box, outline.contour) == (None, ((1.5, 2.25), (3.0, 4.0), (0.1, 9.0)))
    assert [decode_observation(encode_observation(seen)) for seen in (box, outline)] == [box, outline]
    old = orjson.loads(encode_observation(box))
    del old["box"], old["contour"]
    assert not decode_observation(orjson.dumps(old)).has_outline, "recordings of before there were boxes"


def test_who_saw_nothing_says_so_and_why(tmp_path: Path) -> None:
    nothing, fog = load_observations(
        write(tmp_path, {**BARE, "pixels": []}, {**BARE, "pixels": [], "unseen": "fog"})
    ).events()
    assert [(seen.is_empty, seen.unseen) for seen in (nothing, fog)] == [(True, ""), (True, "fog")]
    assert [decode_observation(encode_observation(seen)) for seen in (nothing, fog)] == [nothing, fog]
    old = orjson.loads(encode_observation(nothing))
    del old["unseen"]
    assert decode_observation(orjson.dumps(old)) == nothing, "recordings of before there were reasons"


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        (b"{", "not JSON"),
        (b"[1]", "no JSON object"),
        ({**GOOD, "colour": 1}, "unknown key: got colour"),
        ({**GOOD, "name": ""}, "name is not"),
        ({**GOOD, "name": None}, "name is not"),
        ({**GOOD, "stamp_ns": 1.5}, "stamp_ns is no stamp"),
        ({**GOOD, "stamp_ns": True}, "stamp_ns is no stamp"),
        ({**GOOD, "stamp_ns": "9" * 5000}, "stamp_ns is no stamp"),
        ({**GOOD, "stamp_ns": None}, "stamp_ns is no stamp"),
        ({**GOOD, "unseen": "fog"}, "unseen beside what was seen"),
        ({**BARE, "pixels": [], "unseen": 3}, "unseen is no reason: got 3"),
        ({**BARE, "pixels": [], "unseen": "x" * 201}, "unseen is no reason"),
        ({**BARE, "pixels": [], "unseen": "fog\n"}, "unseen is no reason"),
        ({**GOOD, "pixels": [[1, 2, 3]]}, "pixels are no pixels"),
        ({**GOOD, "pixels": [1, 2]}, "pixels are no pixels"),
        ({**GOOD, "pixels": [["1", 2]]}, "pixels are no pixels"),
        ({**GOOD, "pixels": [[None, 2]]}, "pixels are no pixels"),
        ({**GOOD, "box": [1, 2, 3, 4]}, "pixels beside box: expected one of pixels, box and contour"),
        ({**BARE, "box": [3, 2, 1, 4]}, r"box is no box: got \[3, 2, 1, 4\]"),
        ({**BARE, "box": [1, 2, 3]}, "box is no box"),
        ({**BARE, "box": [1, 2, 3, "4"]}, "box is no box"),
        ({**BARE, "contour": [[1, 2], [3, 4]]}, "contour is no outline: got 2 corners"),
        ({**BARE, "contour": [[1, 2], [3, 4], [5]]}, "contour is no outline"),
        ({**BARE, "contour": [[1, 2]] * 4097}, "got 4097 corners"),
        ({**BARE, "box": [1, 2, 3, 4], "contour": [[1, 2], [3, 4], [5, 9]]}, "box beside contour"),
        (BARE, "pixels are no pixels"),
        (b'{"stamp_ns": 1, "name": "a", "pixels": [[1e999, 2]]}', "seen.jsonl:2"),
        (b'{"stamp_ns": 1, "name": "a", "pixels": [[NaN, 2]]}', "not JSON"),
        ({**GOOD, "std_px": 0}, "std_px"),
        ({**GOOD, "std_px": True}, "std_px"),
        ({**GOOD, "std_px": 1e300}, "std_px"),
        ({**GOOD, "image": -1}, "image is no index"),
        ({**GOOD, "clock": "tai"}, "clock is unknown"),
        ({**GOOD, "clock": []}, "clock is unknown"),
    ],
)
def test_a_wrong_line_is_named(tmp_path: Path, line: object, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence) as caught:
        load_observations(write(tmp_path, GOOD, line))
    assert "seen.jsonl:2" in str(caught.value)


def test_a_missing_file_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        load_observations(tmp_path / "none.jsonl")


def test_the_bus_names_the_probe_by_key_and_takes_recorded_observations(tmp_path: Path) -> None:
    seen = parse_observation(b'{"stamp_ns": 3, "pixels": [[1, 2]]}', name="a", arrival_ns=9, source="k")
    assert (seen.name, seen.stamp_ns, seen.arrival_ns, seen.source) == ("a", 3, 9, "k")
    (recorded,) = load_observations(write(tmp_path, GOOD)).events()
    again = parse_observation(encode_observation(recorded), name="width-a", arrival_ns=9, source="k")
    assert again.pixels == recorded.pixels
    with pytest.raises(InputError, match="another probe"):
        parse_observation(orjson.dumps(GOOD), name="b", arrival_ns=9, source="k")
