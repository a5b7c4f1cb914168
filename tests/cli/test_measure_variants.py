"""``explain`` and ``depth-map`` are ``measure`` with a purpose of their own: its options, its numbers."""

from pathlib import Path

import pytest

CANON = Path(__file__).parents[2] / "configs/cameras/canon-1000d.toml"
POSE = ("--camera", CANON, "--height", 10.48, "--tilt", 67, "--std", "height=0.1,tilt=0.2,px=1")
PROBE = ("--probe", "range 1944,600", "--json")
OF_OTHERS = ("--explain", "--compare", "--depth-map", "--image", "--step")


@pytest.mark.parametrize(
    ("new", "old"),
    [
        (("explain", *POSE, *PROBE), ("measure", *POSE, *PROBE, "--explain")),
        (("explain", *POSE, *PROBE, "--compare"), ("measure", *POSE, *PROBE, "--compare")),
    ],
)
def test_what_measure_is_still_asked_for_is_answered_alike(aerodft, new, old):
    found, before = aerodft(*new), aerodft(*old)
    assert (found.code, found.err) == (before.code, before.err) == (0, "")
    assert found.out == before.out


def test_a_depth_map_is_written_by_either_command(aerodft, tmp_path):
    found = aerodft("depth-map", *POSE, "-o", tmp_path / "new", "--json")
    before = aerodft("measure", *POSE, "--depth-map", tmp_path / "old", "--json")
    assert (found.code, before.code) == (0, 0)
    new, old = found.json, before.json
    names = [{Path(file).name for file in each.pop("files")} for each in (new, old)]
    assert names[0] == names[1] == {path.name for path in (tmp_path / "new").iterdir()}
    assert new == old


def test_help_shows_an_option_where_it_belongs(aerodft):
    measure, explain, depth = (aerodft(name, "--help").out.decode() for name in ("measure", "explain", "depth-map"))
    assert [option for option in OF_OTHERS if option in measure] == []
    assert [option for option in OF_OTHERS if option in explain] == ["--compare"]
    assert [option for option in OF_OTHERS if option in depth] == ["--image", "--step"]
    assert all("--recording" in text and "--terrain" in text for text in (measure, explain, depth))


def test_the_shares_are_a_table_with_what_to_improve_below(aerodft):
    said = aerodft("explain", *POSE, *PROBE[:-1]).out.decode()
    assert said.index("tilt") < said.index("pixels")
    assert "% from tilt: " in said.splitlines()[-1]


def test_what_they_need_is_said(aerodft, tmp_path):
    assert "no --probe" in aerodft("explain", *POSE).last
    assert "--output" in aerodft("depth-map", *POSE).last
    assert "no such option" in aerodft("depth-map", *POSE, "-o", tmp_path / "to", "--probe", "range 1,1").last
