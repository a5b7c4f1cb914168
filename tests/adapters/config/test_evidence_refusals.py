"""What cannot be true of a scene is refused in one sentence that says where, what and why."""

import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerodft.adapters.config.camera import load_camera
from aerodft.adapters.config.evidence import check_against, load_evidence
from aerodft.errors import AerodftError, ConfigError
from aerodft.model import Camera

EXAMPLE = Path(__file__).parents[3] / "configs" / "calibration" / "bridge-landmarks.toml"
CAMERA = Camera.from_fov(name="C", width_px=1920, height_px=1080, hfov_rad=math.radians(60), vfov_rad=math.radians(36))


def point(pixel="[1, 2]", place="position_m = [3, 4, 5]", more=""):
    return f"[[landmark]]\npixel = {pixel}\n{place}\n{more}\n"


P = point()
GEO = 'crs = "geo"\n'
RD = 'crs = "EPSG:28992"\n'
RD_PLACE = "position_m = [192111.4, 313157.7, 138.9]"


def degrees(lat, lon, alt=1):
    return f"lat_deg = {lat}\nlon_deg = {lon}\nalt_m = {alt}"


def sentence_of(folder, text, name="x.toml", crs=None, camera=None):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        check_against(load_evidence(path, crs), camera)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 3
    return str(caught.value).removeprefix(f"{folder}/")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (P + "std = 1\n", "x.toml: landmark[0].std: unknown key"),
        ("[camera]\ntilt_rad = 1.1\n" + P, "x.toml: camera.tilt_rad: unknown key: expected tilt_deg (in degrees); wri"),
        (
            "[camera]\nheight_m = 3\n" + P,
            "x.toml: camera.height_m: unknown key: expected height_agl_m (in metres); wri",
        ),
        (P + "[[ranges]]\n", "x.toml: ranges: unknown key; did you mean range?"),
        ("[[range]]\npixel = [1, 2]\nrange = 3\n", "x.toml: range[0].range: unknown key; did you mean range_m?"),
        (
            "[landmark]\npixel = [1, 2]\n",
            "x.toml: landmark: got one table in single brackets, expected its name in dou",
        ),
        (
            'crs = "local"\n',
            "x.toml: no observations: expected [[landmark]], [[range]], [[length]] or another observat",
        ),
        ("[[landmark]]\nposition_m = [1, 2, 3]\n", "x.toml: landmark[0].pixel: got nothing, expected a value"),
        ("[[landmark]]\npixel = [1, 2]\n", "x.toml: landmark[0].position_m: got nothing, expected position_m, or lat"),
        (point("[nan, 2]"), "x.toml: landmark[0].pixel[0]: got nan, expected a finite number"),
        (point("[1]"), "x.toml: landmark[0].pixel[1]: got nothing, expected a value"),
        (point('["1", 2]'), 'x.toml: landmark[0].pixel[0]: got "1", expected a number'),
        (point(place="position_m = [1, inf, 3]"), "landmark[0].position_m[1]: got inf, expected a finite number"),
        (
            point(place='position_m = [1, "x", 3]'),
            'x.toml: landmark[0].position_m[1]: got "x", expected a number, or "?" where it is not known',
        ),
        (
            point(place='position_m = ["?", "?", 3]'),
            "x.toml: landmark[0].position_m: got 2 unknown, expected one at most; it says nothing otherwise: leave it",
        ),
        (point(more="std_px = 0"), "x.toml: landmark[0].std_px: got 0, expected at least 1e-06"),
        (point(more="std_px = -1"), "x.toml: landmark[0].std_px: got -1, expected at least 1e-06"),
        (point(more="std_m = -0.1"), "x.toml: landmark[0].std_m[0]: got -0.1, expected at least 0"),
        (point(more="std_m = [1, 2]"), "x.toml: landmark[0].std_m[2]: got nothing, expected a value"),
        ("[camera]\ntilt_deg = { value = 3, std = 0 }\n" + P, "camera.tilt_deg.std: got 0, expected more than 0"),
        ("[camera]\ntilt_deg = { value = 3, std = -2 }\n" + P, "camera.tilt_deg.std: got -2, expected more than 0"),
        ("[camera]\ntilt_deg = 181\n" + P, "x.toml: camera.tilt_deg.value: got 181, expected at most 180"),
        ("[camera]\nheight_agl_m = 0\n" + P, "x.toml: camera.height_agl_m.value: got 0, expected more than 0"),
        ("[camera]\nposition_m = [1]\n" + P, "x.toml: camera.position_m.value: got [1], expected at least 2 of them"),
        (
            "[camera]\nposition_m = { value = [1, 2], std = [1, 2, 3] }\n" + P,
            "x.toml: camera.position_m.std: got 3 stds, expected one, or 2 as the position has",
        ),
        (
            "[camera]\nposition_m = [1, 2, 3]\nheight_agl_m = 3\n" + P,
            "x.toml: camera.height_agl_m: it stands beside a height in position_m, expected one of the two",
        ),
        (
            "[camera]\nposition_m = [1, 2, 3]\nlat_deg = 3\n" + P,
            "x.toml: camera.lat_deg: it stands beside position_m, expected one of the two",
        ),
        ("[camera]\nlat_deg = 3\n" + P, "x.toml: camera.lon_deg: got nothing, expected a number"),
        (
            "[camera]\nposition_m = [1, 2]\nposition_std_m = 1\n" + P,
            "x.toml: camera.position_std_m: it stands without lat_deg, expected lat_deg and lon_deg; write position_m",
        ),
        ("[image]\nwidth_px = 3\n" + P, "x.toml: image.height_px: got nothing, expected both width_px and height_px"),
        ("[[range]]\npixel = [1, 2]\nrange_m = 0\n", "x.toml: range[0].range_m: got 0, expected more than 0"),
        (
            "[[length]]\npixels = [[1, 2], [3, 4]]\nlength_m = -3\n",
            "x.toml: length[0].length_m: got -3, expected more than 0",
        ),
        (
            "[[length]]\npixels = [[1, 2], [1, 2]]\nlength_m = 3\n",
            "x.toml: length[0].pixels: got [1.0, 2.0] twice, expected two pixels that differ",
        ),
        (
            "[[height]]\nbase = [1, 2]\ntop = [1, 2]\nheight_m = 3\n",
            "x.toml: height[0].top: got [1.0, 2.0], the pixel of base, expected another pixel",
        ),
        ("[[horizon]]\npixels = [[1, 2]]\n", "x.toml: horizon[0].pixels: got [[1, 2]], expected at least 2 of them"),
        ("[[horizon]]\npixels = [[1, 2], [1, 2]]\n", "horizon[0].pixels: got [1.0, 2.0] twice, expected pixels that d"),
        (
            "[[parallel]]\nlines = [[[1, 2], [3, 4]], [[3, 4], [1, 2]]]\n",
            "x.toml: parallel[0].lines: got one line twice, expected two lines",
        ),
        ("[[vertical]]\npixels = [[1, 2], [3, 4]]\nstd_m = 1\n", "vertical[0].std_m: unknown key"),
        (
            point(more='name = "a"') + point("[3, 4]", "position_m = [1, 2, 3]", 'name = "a"'),
            'x.toml: landmark[1]: name: got "a", which landmark[0] has, expected a name of its own',
        ),
        (
            P + point(place="position_m = [5, 4, 5]"),
            "x.toml: landmark[1]: pixel: got [1, 2], which landmark[0] has with another place, [3, 4, 5], expected a",
        ),
        (
            P + point("[7, 8]"),
            "x.toml: landmark[1]: place: got [3, 4, 5], which landmark[0] has with another pixel, [1, 2], expected a",
        ),
        (P + P, "landmark[1]: pixel: got [1, 2], which landmark[0] has with the same place, expected a pixel of its o"),
    ],
)
def test_a_wrong_value_is_named_with_its_table(tmp_path, text, sentence):
    assert sentence in sentence_of(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            'crs = "utm"\n' + P,
            'x.toml: crs: got "utm", expected "local", "geo" or an EPSG code; "local" is metres from a z',
        ),
        ('crs = "EPSG:5384"\n' + P, 'x.toml: crs: got "EPSG:5384", which is not in the EPSG register; "local" is'),
        ('crs = "EPSG:32600"\n' + P, 'crs: got "EPSG:32600", which is not in the EPSG register; "local" is'),
        ('crs = "+proj=oops"\n' + P, 'crs: got "+proj=oops", which PROJ does not take; "local" is'),
        (
            'crs = "EPSG:2264"\n' + P,
            'x.toml: crs: got "EPSG:2264" (NAD83 / North Carolina (ftUS)), which counts in US survey foot, exp',
        ),
        ('crs = "EPSG:4978"\n' + P, 'crs: got "EPSG:4978" (WGS 84), Geocentric CRS, expected a projected or geographi'),
        ('crs = "EPSG:2053"\n' + P, "expected axes to the east and to the north; use another projection"),
        ('crs = "EPSG:3031"\n' + P, "expected axes to the east and to the north; use another projection"),
        (
            GEO + '[camera]\nlat_deg = 50\nlon_deg = "?"\n' + point(place=degrees(50, 5)),
            'x.toml: camera.lon_deg: got "?", expected a number; leave out what nobody knows',
        ),
        (
            point(place=degrees(50, 5)),
            'x.toml: landmark[0]: place: got latitude and longitude with crs = "local", expected position_m; degrees n',
        ),
        (
            GEO + point(place=degrees(50, 5)) + point("[5, 6]"),
            'x.toml: landmark[1]: place: got position_m with crs = "geo", expected lat_deg, lon_deg and alt_m; all pla',
        ),
        (
            RD + "[camera]\nlat_deg = 50\nlon_deg = 5\n" + point(place=RD_PLACE),
            'x.toml: camera: place: got latitude and longitude with crs = "EPSG:28992", expected position_m; all',
        ),
        (
            GEO + point(place="lat_deg = 50\nlon_deg = 5"),
            'x.toml: landmark[0].alt_m: got nothing, expected a number; write "?" for the one component that nobody kn',
        ),
        (
            GEO + point(place=degrees(50, 5) + "\nposition_m = [1, 2, 3]"),
            "x.toml: landmark[0].lat_deg: it stands beside position_m, expected one of the two",
        ),
        (
            GEO + point(place=degrees(149.1, -35.3)),
            "x.toml: landmark[0].lat_deg: got 149.1, expected -90 to 90; swap lat_deg and lon_deg",
        ),
        (GEO + point(place=degrees(91, 95)), "x.toml: landmark[0].lat_deg: got 91, expected -90 to 90"),
        (GEO + point(place=degrees(9, 361)), "x.toml: landmark[0].lon_deg: got 361, expected -180 to 360"),
        (
            GEO
            + "".join(point(f"[{i}, 2]", degrees(*ll)) for i, ll in enumerate([(50, 5.9), (50.001, 5.9), (5.9, 50)])),
            "x.toml: landmark[2]: place: got [5.9, 50, 1], 6118 km from the others, expected 100 km at most; chec",
        ),
        (
            GEO + point(place=degrees(0.8867516, 0.1032120)) + point("[3, 4]", degrees(0.8867524, 0.1032128)),
            "x.toml: latitudes and longitudes: got 0.886752 and 0.103212, in the open sea off Africa, expected deg",
        ),
        (
            RD + point(place="position_m = [313157.7, 192111.4, 138.9]"),
            "x.toml: landmark[0]: place: got easting 313157.7 and northing 192111.4, expected a place where EPSG:28",
        ),
        (
            RD + point(place="position_m = [463000.0, 155000.0, 138.9]"),
            "longitudes 3.2 to 7.22; swap them: easting comes first",
        ),
        (RD + point(place="position_m = [1e9, 1e9, 138.9]"), "check crs, and that no digits are missing"),
        (
            RD + "[[range]]\npixel = [1, 2]\nrange_m = 3\n",
            'x.toml: crs: got "EPSG:28992" and no place in it, expected a landmark, or the camera\'s position; without',
        ),
        (
            RD + "[camera]\nposition_m = [192111.4, 313157.7, 145.9]\n[[range]]\npixel = [1, 2]\nrange_m = 3\n",
            "x.toml: elevation_m: got nothing, expected the height of the ground or water, as no landmark has one; the",
        ),
    ],
)
def test_places_that_are_none_are_named(tmp_path, text, sentence):
    assert sentence in sentence_of(tmp_path, text)


SWAPPED = "".join(
    point(f"[{x}, {y}]", f"position_m = [{u}, {v}, 3]")
    for x, y, u, v in [(192111.4, 313157.7, 12, 604), (192120.4, 313150.7, 500, 64), (192130.4, 313160.7, 1720, 900)]
)
SIZED = "[image]\nwidth_px = 1920\nheight_px = 1080\n"


def test_swapped_columns_are_told_from_a_slip(tmp_path):
    for text in (SWAPPED, RD + SWAPPED, SIZED + SWAPPED):
        found = sentence_of(tmp_path, text)
        assert "landmark[0]: pixel: got [192111.4, 313157.7], and a place [12, 604, 3] that would be one" in found
        assert found.endswith("swap pixels and places: they look interchanged")
    negative = point("[-12.5, 40]", "position_m = [812, 604, 0]") + point("[-3.5, 20]", "position_m = [500, 300, 0]")
    assert "swap pixels and places" in sentence_of(tmp_path, negative, camera=CAMERA)
    slip = P + point("[19200, 3]", "position_m = [3, 5, 5]") + point("[4, 4]", "position_m = [4, 5, 5]")
    assert sentence_of(tmp_path, slip, camera=CAMERA) == (
        "x.toml: landmark[1]: pixel: got [19200, 3], expected a pixel of the image, -0.5 to 1919.5 across and -0.5 to "
        "1079.5 down"
    )
    turned = P + point("[500, 1800]", "position_m = [3, 5, 5]") + point("[4, 4]", "position_m = [4, 5, 5]")
    found = sentence_of(tmp_path, SIZED + turned)
    assert found.endswith("give u (across) before v (down): they look swapped")


@pytest.mark.parametrize(
    "text",
    [
        "[[range]]\npixel = [5, 1080]\nrange_m = 3\n",
        "[[height]]\nbase = [1, 2]\ntop = [5, 1080]\nheight_m = 3\n",
        "[[length]]\npixels = [[1, 2], [5, 1080]]\nlength_m = 3\n",
        "[[right_angle]]\nlines = [[[1, 2], [3, 4]], [[5, 1080], [7, 8]]]\n",
    ],
)
def test_every_pixel_must_be_in_the_image(tmp_path, text):
    found = sentence_of(tmp_path, text, camera=CAMERA)
    assert "[0]: pixel: got [5, 1080], expected a pixel of the image" in found


def test_a_camera_of_another_size_is_refused(tmp_path):
    small = Camera.from_fov(name="small", width_px=640, height_px=480, hfov_rad=1.0, vfov_rad=0.7)
    assert sentence_of(tmp_path, SIZED + P, camera=small) == (
        'x.toml: image: got 1920 x 1080 pixels, expected 640 x 480, the size of camera "small"; take the camera file '
        "of the mode that the image was taken in"
    )


RANGE = "[[range]]\npixel = [960, 540]\nrange_m = 26.8\n"


@pytest.mark.parametrize(
    ("text", "tilt_deg"),
    [
        ("[camera]\nheight_agl_m = 10.48\ntilt_deg = {}\n" + RANGE, 67.0),
        ("[camera]\nheight_agl_m = 10.48\ntilt_deg = {}\n[[ground]]\npixel = [960, 540]\nxy_m = [0, 24.7]\n", 67.0),
        (
            "[camera]\nposition_m = [1, 2, 10.48]\ntilt_deg = {}\n" + point("[960, 540]", "position_m = [1, 26.7, 0]"),
            67.0,
        ),
        ("[camera]\ntilt_deg = {}\n[[horizon]]\npixels = [[0, 300], [1919, 310]]\n", 82.6),
    ],
)
def test_a_tilt_in_radians_is_told_where_it_can_be(tmp_path, text, tilt_deg):
    meant = f"{math.radians(tilt_deg):.4f}"
    found = sentence_of(tmp_path, text.replace("{}", meant), camera=CAMERA)
    assert found.startswith(
        f"x.toml: camera.tilt_deg: got {meant}, with which the camera sees none of what was observed"
    )
    assert found.endswith(f"if it is in radians, write {math.degrees(float(meant)):.2f}")
    path = tmp_path / "right.toml"
    for right in (f"{tilt_deg}", f"{{ value = {meant}, std = 30 }}", "1e-3"):
        path.write_text(text.replace("{}", right))
        check_against(load_evidence(path), CAMERA)


def test_a_camera_that_looks_down_may(tmp_path):
    path = tmp_path / "x.toml"
    path.write_text("[camera]\nheight_agl_m = 26.8\ntilt_deg = 1.2\n" + RANGE)
    check_against(load_evidence(path), CAMERA)


ROWS = "1,2,3,4,5\n6,7,8,9,10\n"


@pytest.mark.parametrize(
    ("header", "row", "want"),
    [
        ("u,v,X,Y,Z", "1,2,3,4,5", (3, 4, 5)),
        ("X,Y,Z,x,y", "3,4,5,1,2", (3, 4, 5)),
        ("x;y;X;Y;Z", "1;2;3;4;5", (3, 4, 5)),
        ("U\tV\tx_m\ty_m\tz_m", "1\t2\t3\t4\t5", (3, 4, 5)),
        ("name, u, v, easting, northing, height", '"a, b", 1, 2, 3, 4, 5', (3, 4, 5)),
        ("# a comment\n\nu,v,X,Y,Z,std_px,std_m", "\n# one more\n1,2,3,4,?,0.5,0.1", (3, 4, None)),
        ("\ufeffID,x_px,y_px,East,North,Up", "7,1,2,3,4,5", (3, 4, 5)),
    ],
)
def test_csv_columns_go_by_many_names(tmp_path, header, row, want):
    path = tmp_path / "x.csv"
    path.write_text(f"{header}\n{row}\n", encoding="utf-8")
    (landmark,) = load_evidence(path).known.evidence
    assert landmark.pixel == (1.0, 2.0)
    assert landmark.position_m == want
    assert landmark.name == ("a, b" if "a, b" in row else "7" if "ID" in header else "landmark-1")
    assert (landmark.std_px, landmark.std_m) == ((0.5, (0.1,) * 3) if "std_px" in header else (1.0, (0.0,) * 3))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            "",
            "x.csv: no header: got an empty file, expected columns u, v (pixels) and X, Y, Z (metres) or lat, lon, alt",
        ),
        (ROWS, 'x.csv: the header names no columns with pixels and places: got "1, 2, 3, 4, 5", expected columns u, v'),
        ("u,v,X,Y\n1,2,3,4\n", 'x.csv: the header names no columns with places: got "u, v, X, Y", expected columns u'),
        ("X,Y,Z\n1,2,3\n", 'x.csv: the header names no columns with pixels: got "X, Y, Z", expected columns u, v'),
        (
            "u,v,X,Y,Z,std_pix\n",
            'x.csv: the header: got a column "std_pix", expected columns u, v (pixels) and X, Y, Z',
        ),
        ("u,v,X,Y,Z,u\n", 'x.csv: the header: got "u" twice, expected each column once'),
        ("u,v,X,Y,Z\n", "x.csv: holds no points: got a header only, expected a row for each landmark"),
        ("u,v,X,Y,Z\n1,2,3,4\n", "x.csv: line 2: got 4 cells, expected 5 as the header"),
        (
            "u,v,X,Y,Z\n\n1,5,2,3,4,5\n",
            "x.csv: line 3: got 6 cells, expected 5 as the header; decimals take a point, a",
        ),
        ("u;v;X;Y;Z\n1;2;3,5;4;5\n", 'x.csv: line 2, column "X": got "3,5", expected a number, or "?" where it is not'),
        ("u,v,X,Y,Z\n1,,3,4,5\n", 'x.csv: line 2, column "v": got nothing, expected a number'),
        ("u,v,X,Y,Z\n1,?,3,4,5\n", 'x.csv: line 2, column "v": got "?", expected a number'),
        ("u,v,X,Y,Z\n1,2,nan,4,5\n", 'x.csv: line 2, column "X": got "nan", expected a finite number'),
        ("u,v,X,Y,Z\n1,2,3,4,5\n1,3,?,?,5\n", "x.csv: line 3, position_m: got 2 unknown, expected one at most"),
        ("u,v,X,Y,Z,std_px\n1,2,3,4,5,0\n", "x.csv: line 2, std_px: got 0.0, expected at least 1e-06"),
        (
            "u,v,X,Y,Z\n1,2,3,4,5\n1,2,4,4,5\n",
            "x.csv: line 3: pixel: got [1, 2], which line 2 has with another place, [",
        ),
        ("u,v,lat,lon,alt\n1,2,149,-35,5\n", "x.csv: line 2, lat_deg: got 149, expected -90 to 90; swap lat_deg and l"),
        ('u,v,X,Y,Z\n1,2,3,4,"5\n', "x.csv: line 2: not CSV: unexpected end of data; correct that line"),
    ],
)
def test_a_wrong_csv_is_refused_with_its_line(tmp_path, text, sentence):
    assert sentence in sentence_of(tmp_path, text, "x.csv")


def test_files_that_are_none_are_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"none\.csv: no such file; check the path"):
        load_evidence(tmp_path / "none.csv")
    (tmp_path / "x.csv").write_bytes(b"\xff\xd8\xff\xe0" + bytes(100))
    with pytest.raises(ConfigError, match=r"x\.csv: not a text file: got a JPEG image, expected CSV"):
        load_evidence(tmp_path / "x.csv")
    assert "crs`: got geo beside this file, expected it in the file" in sentence_of(tmp_path, P, crs="geo")
    assert 'crs: got "x", expected "local"' in sentence_of(tmp_path, "u,v,X,Y,Z\n" + ROWS, "x.csv", crs="x")


@settings(max_examples=40, deadline=None)
@given(where=st.integers(0, 3000), junk=st.text(max_size=6), cut=st.integers(0, 40))
def test_a_damaged_file_is_read_or_refused_in_a_sentence(tmp_path_factory, where, junk, cut):
    text = EXAMPLE.read_text()
    folder = tmp_path_factory.mktemp("damaged")
    damaged = text[:where] + junk + text[where + cut :]
    rows = "name;u;v;X;Y;Z\n" + "".join(f"p{i};{i}.5;{2 * i};{i};{i * i};0\n" for i in range(9))
    at = where % len(rows)
    for name, content in (("x.toml", damaged), ("x.csv", rows[:at] + junk + rows[at + cut % 9 :])):
        path = folder / name
        path.write_text(content, encoding="utf-8", errors="replace")
        try:
            check_against(load_evidence(path), load_camera(EXAMPLE.parents[1] / "cameras" / "demo-1080p.toml"))
        except AerodftError as error:
            assert "\n" not in str(error)  # noqa: PT017 - most of them raise, but not all
