"""Whatever a value says, a page shows it and nothing else."""

from html.parser import HTMLParser
from types import SimpleNamespace

import pytest
from jinja2 import UndefinedError
from markdown_it import MarkdownIt

from aerodft.reports.rendering import render_html, render_markdown

HOSTILE = '<script>alert("1")</script> & | *b* _i_ [x](y) `c`\n# d {{ 7 * 7 }}'
LENS = {
    "view_count": 3,
    "image_count": 4,
    "size_px": (640, 480),
    "board": HOSTILE,
    "corner_count": 12,
    "rms_px": 0.25,
    "software": "s",
    "written_at": "now",
    "missing": [HOSTILE],
    "parameters": [(HOSTILE, "1", "2")],
    "notes": [HOSTILE],
    "figures": [("data:image/png;base64,", HOSTILE)],
}
CAMERA = {
    "source": {"name": HOSTILE, "sha256": "0"},
    "written_at": "now",
    "software": "s",
    "crs": HOSTILE,
    "parameters": [{"key": "tilt_deg", "value": "-1.0", "std": "0.1", "low": "-1.2", "high": "-0.8"}],
    "correlations": [("a_b", [1.0, None]), ("c", [None, 1.0])],
    "fit": ["It fits (well)."],
    "weakest_names": ["a_b", "c", "d"],
    "weakest_percent": "3",
    "limit_percent": "5",
    "sentences": [HOSTILE],
    "residuals_file": "r.png",
    "image_file": "i.jpg",
    "image_notes": [HOSTILE],
    "observations": [
        {"name": HOSTILE, "is_outlier": True, "kind": "k", "px": "1", "sigma": "2", "ground_m": "", "loo_ground_m": "3"}
    ],
    "outliers": [HOSTILE],
    "is_dft": True,
    "place": ("1", "2", "3"),
    "lat_deg": None,
    "lon_deg": None,
    "known": [{"key": "fx_px", "value": "1", "std": "", "is_stated": True}],
}


def read(html: str) -> SimpleNamespace:
    """Elements in order, and the whole text."""
    elements, words, parser = list[str](), list[str](), HTMLParser()
    parser.handle_starttag = lambda tag, _: elements.append(tag)
    parser.handle_data = words.append
    parser.feed(html)
    return SimpleNamespace(elements=elements, text=" ".join(" ".join(words).split()))


def test_html_shows_a_text_of_markup_as_it_is() -> None:
    page, plain = (read(render_html("lens", **LENS, name=name)) for name in (HOSTILE, "x"))
    assert page.elements == plain.elements
    assert page.text.count(" ".join(HOSTILE.split())) == plain.text.count(" ".join(HOSTILE.split())) + 2


def test_markdown_shows_a_text_of_markup_as_it_is() -> None:
    text = render_markdown("camera", **CAMERA, camera=HOSTILE)
    page, plain = (
        read(MarkdownIt("commonmark").enable("table").render(render_markdown("camera", **values)))
        for values in ({**CAMERA, "camera": HOSTILE}, {**CAMERA, "camera": "x"})
    )
    assert page.elements == plain.elements
    assert not {"script", "a", "em", "code"} & {*page.elements}
    assert page.elements.count("table") == 3
    shown = " ".join(HOSTILE.split())
    for about in ("From {} (sha256 0)", "coordinates: {}.", "Left out: {}.", "{} (left out)", "{}."):
        assert about.format(shown) in page.text
    assert "the combination of a_b, c and d" in page.text
    assert text.endswith(".\n")


def test_a_value_that_nobody_gave_is_an_error() -> None:
    with pytest.raises(UndefinedError, match="'name' is undefined"):
        render_html("lens", **LENS)
