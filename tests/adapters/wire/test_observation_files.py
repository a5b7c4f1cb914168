"""Observation files: what is read, and what is refused, by line."""

from pathlib import Path

import orjson
import pytest

from aerodft.adapters.wire.events import encode_observation
from aerodft.adapters.wire.requests import load_observations, parse_observation
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
        (b"null", "no JSON object: got null,"),
        ({**GOOD, "colour": 1}, "colour: unknown key"),
        ({**GOOD, "name": ""}, 'name: got "", expected text'),
        ({**GOOD, "name": None}, "name: got null, expected text"),
        ({**GOOD, "stamp_ns": 1.5}, "stamp_ns: got 1.5, expected a whole number"),
        ({**GOOD, "stamp_ns": True}, "stamp_ns: got true"),
        ({**GOOD, "stamp_ns": "9" * 5000}, "stamp_ns: got .*, expected at most"),
        ({**GOOD, "stamp_ns": None}, "stamp_ns: got nothing, expected nanoseconds UTC"),
        ({**GOOD, "unseen": "fog"}, "unseen: it stands beside what was seen"),
        ({**BARE, "pixels": [], "unseen": 3}, "unseen: got 3, expected text"),
        ({**BARE, "pixels": [], "unseen": "x" * 201}, "unseen: got .*, expected at most 200"),
        ({**BARE, "pixels": [], "unseen": "fog\n"}, "unseen: got .*, expected a sentence in one line"),
        ({**GOOD, "pixels": [[1, 2, 3]]}, r"pixels\[0\]: got"),
        ({**GOOD, "pixels": [1, 2]}, r"pixels\[0\]: got 1, expected a list"),
        ({**GOOD, "pixels": [["1", 2]]}, r"pixels\[0\]\[0\]: got \"1\", expected a number"),
        ({**GOOD, "pixels": [[None, 2]]}, r"pixels\[0\]\[0\]: got null, expected a number"),
        ({**GOOD, "box": [1, 2, 3, 4]}, "pixels: it stands beside box, expected one of pixels, box and contour"),
        ({**BARE, "box": [3, 2, 1, 4]}, r"box: got \[3.0, 2.0, 1.0, 4.0\], expected \[left, top"),
        ({**BARE, "box": [1, 2, 3]}, r"box\[3\]: got nothing"),
        ({**BARE, "box": [1, 2, 3, "4"]}, r"box\[3\]: got \"4\", expected a number"),
        ({**BARE, "contour": [[1, 2], [3, 4]]}, "contour: got .*, expected at least 3 of them"),
        ({**BARE, "contour": [[1, 2], [3, 4], [5]]}, r"contour\[2\]\[1\]: got nothing"),
        ({**BARE, "contour": [[1, 2]] * 4097}, "contour: got .*, expected at most 4096 of them"),
        ({**BARE, "box": [1, 2, 3, 4], "contour": [[1, 2], [3, 4], [5, 9]]}, "box: it stands beside contour"),
        (BARE, "pixels: got nothing"),
        (b'{"stamp_ns": 1, "name": "a", "pixels": [[1e999, 2]]}', "seen.jsonl:2"),
        (b'{"stamp_ns": 1, "name": "a", "pixels": [[NaN, 2]]}', "not JSON"),
        ({**GOOD, "std_px": 0}, "std_px"),
        ({**GOOD, "std_px": True}, "std_px"),
        ({**GOOD, "std_px": 1e300}, "std_px"),
        ({**GOOD, "image": -1}, "image: got -1, expected at least 0"),
        ({**GOOD, "clock": "tai"}, 'clock: got "tai", expected'),
        ({**GOOD, "clock": []}, "clock: got"),
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
