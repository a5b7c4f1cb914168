"""The page's words: numbers with two digits of their interval, titles with keys, sentences without parameters."""

import json
from pathlib import Path

import pytest

from tests.web.pages import needs_browser, shown_measurement

STATIC = Path(__file__).parents[2] / "aerodft/web/static"
WIDTH = {"status": "ok", "reasons": [], "value": 12.3456, "unit": "m", "std": 0.1, "ci95": [12.1496, 12.5416]}
REFUSED = {"status": "above_horizon", "reasons": ["it sees no ground", "state `height_m`"], "value": None}
PLACE = {
    "status": "ok",
    "reasons": [],
    "value": None,
    "ground_m": [[-3.0, 40.04, 0.0]],
    "ellipse95": {"semi_major_m": 0.49},
}
POSE = {
    "status": "ok",
    "reasons": [],
    "height_agl_m": 20.04,
    "height_source": "rangefinder",
    "tilt_deg": 50.126,
    "heading_deg": 359.97,
    "telemetry_age_s": 0.5,
    "std": {"height_agl_m": 0.3, "tilt_deg": 0.25},
}
POSE_TEXT = (
    "Height 20.04 m ± 0.30 m (rangefinder), tilt 50.13 ± 0.25°, heading 0.0°, telemetry 0.50 s old;"
    " ± is one standard deviation."
)
NO_POSE_TEXT = (
    "The camera's pose is not known yet: mark what you know of the view, or open it with --height and --tilt"
    " if they are known."
)

pytestmark = needs_browser


@pytest.fixture(scope="module")
def script(browser):
    """Call a function of a module that imports nothing."""
    page = browser.new_page()

    def call(module: str, name: str, *arguments: object) -> object:
        source = (STATIC / module).read_text(encoding="utf-8")
        code = (
            "async ([source, name, given]) => {"
            " const address = URL.createObjectURL(new Blob([source], { type: 'text/javascript' }));"
            " const found = (await import(address))[name];"
            " return typeof found === 'function' ? found(...given) : found; }"
        )
        return page.evaluate(code, [source, name, list(arguments)])

    page.goto("data:text/html,<title>words</title>")
    yield call
    page.close()


@pytest.mark.parametrize(
    ("name", "arguments", "said"),
    [
        ("valueText", (WIDTH, "m"), "12.35 m [12.15 … 12.54] 95 %"),
        ("valueText", (WIDTH, "ft"), "40.5 ft [39.9 … 41.1] 95 %"),
        (
            "valueText",
            ({**WIDTH, "value": 100.0, "unit": "m2", "ci95": [90.0, 110.0]}, "ft"),
            "1076 ft² [969 … 1184] 95 %",
        ),
        (
            "valueText",
            ({**WIDTH, "value": -0.004, "unit": "deg", "ci95": [-0.2, 0.2]}, "m"),
            "0.00 ° [-0.20 … 0.20] 95 %",
        ),
        ("valueText", (REFUSED, "m"), "ABOVE_HORIZON: it sees no ground; state height"),
        ("valueText", (PLACE, "m"), "left 3.00 m, ahead 40.04 m ± 0.49 m (95 %)"),
        ("valueText", ({**PLACE, "ground_m": [[3.0, 40.0, 0.0]], "ellipse95": None}, "m"), "right 3.0 m, ahead 40 m"),
        ("labelText", ({**WIDTH, "name": "w"}, "m"), "w 12.35 m [12.15 … 12.54]"),
        ("labelText", ({**REFUSED, "name": "w"}, "m"), "w ABOVE_HORIZON"),
        ("stdText", (0.12345, "m", "ft"), "0.41 ft"),
        ("gridText", ({"at_m": -20.0, "axis": "right"}, "m"), "20 m left"),
        ("gridText", ({"at_m": 30.48, "axis": "ahead"}, "ft"), "100 ft ahead"),
        ("gridText", ({"at_m": 0, "axis": "ahead"}, "m"), "0 m"),
        ("samplingText", ([0.0123, 0.456], "m"), "a pixel is 1.2 cm wide, 0.46 m deep"),
        ("samplingText", (None, "m"), ""),
        ("poseText", (POSE, "m"), POSE_TEXT),
        ("poseText", (None, "m"), NO_POSE_TEXT),
        (
            "reachText",
            ({"status": "ok", "reasons": [], "width_m": {"median": 7.5, "ci95": [7.0, 8.0], "transects": 31}}, "m"),
            "7.5 m [7.0 … 8.0] 95 %, the median of 31 transects.",
        ),
        ("clock", ("1795221278868833001",), "00:34:38 UTC"),
        ("day", ("1795221278868833001",), "2026-11-21 00:34:38.868 UTC"),
        (
            "plain",
            ("state `sigma_px`, or add focal to `unknowns`",),
            "state sigma, or find the focal length too, below",
        ),
        ("quality", (WIDTH,), "good"),
        ("quality", ({**WIDTH, "std": 0.5},), "fair"),
        ("quality", ({**WIDTH, "std": 2.0},), "poor"),
        ("quality", (REFUSED,), "refused"),
        (
            "heightsOf",
            ({"heights": {"elevation_m": "1,5; 2 -0.25", "elevation_std_m": "0.1", "none": " "}},),
            {"elevation_m": [1.5, 2, -0.25], "elevation_std_m": 0.1},
        ),
    ],
)
def test_a_value_is_said_in_words(script, name, arguments, said):
    assert script("measuring/words.js", name, *arguments) == said


def test_a_length_has_the_digits_of_the_command_line(script):
    for value, half in ((12.3456, 0.196), (0.01234, 0.0005), (4321.0, 55.0), (7.0, 1e-9)):
        found = {**WIDTH, "value": value, "ci95": [value - half, value + half]}
        assert script("measuring/words.js", "valueText", found, "m") == shown_measurement(found)


def test_what_is_copied_is_the_answer_without_the_page_s_own(script):
    mark = {"name": "a", "kind": "width", "points": [[1.5, 2], [3, 4]], "heights": {"elevation_m": "1"}}
    mark["found"] = {**WIDTH, "budget": [], "advice": "", "command": "aerodft measure", "geojson": None}
    assert json.loads(str(script("measuring/words.js", "copyText", "json", mark, "m"))) == WIDTH
    assert script("measuring/words.js", "copyText", "command", mark, "m") == "aerodft measure"
    probe = '[[probe]]\nname = "a"\nkind = "width"\npixels = [[1.5, 2], [3, 4]]\nelevation_m = 1\n'
    assert script("measuring/words.js", "copyText", "probe", mark, "m") == probe


def test_every_tool_has_a_key_of_its_own_and_says_it(script):
    tables = [script("tools.js", name) for name in ("MEASURES", "DRAWN", "PRESSED")]
    words = [each for table in tables for each in table.values()]
    keys = [each["key"] for each in words if "key" in each]
    assert len(set(keys)) == len(keys) == 14
    assert all(each["help"].endswith(".") for table in tables[:2] for each in table.values())
    assert script("tools.js", "titleText", tables[0]["width"]) == "Width: two banks (W)"
    assert script("tools.js", "titleText", tables[2]["play"]) == "Play (space)"
    assert script("tools.js", "titleText", tables[1]["water"]) == ""
