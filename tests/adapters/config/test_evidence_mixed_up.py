"""Files that somebody mixed up before any camera comes into it: encodings, missing headers, datums, image sizes."""

import pytest

from aerodft.adapters.config.evidence import load_evidence
from aerodft.errors import ConfigError

from .test_evidence_refusals import CAMERA, RD, degrees, point, sentence_of

HEADER = "name,u,v,X,Y,Z\n"
ROW = "a,10,20,1,2,3\n"
NAMED = HEADER + "Brücke ✓,10,20,1,2,3\n"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_spreadsheets_text_is_read_in_any_unicode(tmp_path, encoding):
    path = tmp_path / "points.csv"
    path.write_bytes(NAMED.encode(encoding))
    assert load_evidence(path).known.evidence[0].name == "Brücke ✓"


def test_another_encoding_is_named_with_its_line(tmp_path):
    path = tmp_path / "points.csv"
    path.write_bytes((HEADER + ROW + ROW.replace("a", "Brücke")).encode("latin-1"))
    with pytest.raises(ConfigError, match=r"line 3: got letters in another encoding than UTF-8.*save it as UTF-8"):
        load_evidence(path)


def test_a_table_without_names_is_told_from_one_with_other_names(tmp_path):
    assert "its first line is a row of data" in sentence_of(tmp_path, ROW + ROW, "x.csv")
    assert "row of data" not in sentence_of(tmp_path, "name,a,b,c,d,e\n" + ROW, "x.csv")


def test_a_million_points_are_refused_before_they_cost_anything(tmp_path):
    rows = "".join(f"p{k},{k % 1900},{k // 1900},{k},0,0\n" for k in range(100_000))
    assert "got more, expected 10000 landmarks at most; take some" in sentence_of(tmp_path, HEADER + rows, "x.csv")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            RD + "elevation_m = 57.0\n" + point(place="position_m = [192111.4, 313157.7, 10.2]"),
            "elevation_m: got 57, 46.8 m above the highest landmark",
        ),
        (
            'crs = "geo"\n' + point("[52.1, 5.3]", degrees(978.9, 456.0)),
            "pixel [52.1, 5.3] that would be a place, expected -90 to 90; swap pixels and places",
        ),
        (point("[2500, 1300]") + point("[100, 90]", "position_m = [3, 5, 5]"), "an image of 2880 x 1620?"),
        (point("[3800, 2100]") + point("[100, 90]", "position_m = [3, 5, 5]"), "an image of 3840 x 2160?"),
    ],
)
def test_what_was_mixed_up_is_guessed(tmp_path, text, sentence):
    assert sentence in sentence_of(tmp_path, text, camera=CAMERA)


def test_metres_that_could_be_pixels_are_not_called_interchanged_for_it(tmp_path):
    text = point("[2500, 1300]", "position_m = [3, 4, 5]") + point("[2100, 90]", "position_m = [9, 5, 5]")
    assert "interchanged" not in sentence_of(tmp_path, text, camera=CAMERA)


def test_pixels_outside_are_named_where_no_landmark_has_an_easting(tmp_path):
    places = ('position_m = ["?", 4, 5]', 'position_m = ["?", 5, 5]')
    text = point("[2500, 1300]", places[0]) + point("[2100, 90]", places[1])
    assert "an image of 2880 x 1620?" in sentence_of(tmp_path, text, camera=CAMERA)
