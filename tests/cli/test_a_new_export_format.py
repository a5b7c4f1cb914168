"""A format that is an entry of ``EXPORTERS`` is offered by the command and by Python."""

from dataclasses import replace

import aerodft as ad
from replay.export import EXPORTERS

RECORDING = "tests/cli/frozen-0.1"


def lines(items):
    for item in items:
        yield f"{item['name']} {item['value']}\n"


def test_a_new_text_format_is_one_entry(aerodft, tmp_path, monkeypatch):
    monkeypatch.setitem(EXPORTERS, "txt", replace(EXPORTERS["csv"], name="txt", endings=(".txt",), lines=lines))
    by_ending = aerodft("export", RECORDING, "-o", tmp_path / "x.txt", "--json")
    assert (by_ending.code, by_ending.json["format"], by_ending.json["measurements"]) == (0, "txt", 118)
    on_stdout = aerodft("export", RECORDING, "--format", "txt").out
    assert on_stdout == (tmp_path / "x.txt").read_bytes()
    assert on_stdout.startswith(b"centre None\n")
    assert ad.export(RECORDING, tmp_path / "y.txt").counts == {"measurements": 118}
    as_table = aerodft("export", RECORDING, "--format", "csv", "-o", tmp_path / "z.txt")
    assert (as_table.code, (tmp_path / "z.txt").read_text()[:8]) == (0, "time_utc")


def test_a_format_that_is_none_is_named_with_those_that_are(aerodft, tmp_path):
    done = aerodft("export", RECORDING, "--format", "xls")
    assert (done.code, "csv, geojson, gpkg" in done.last) == (2, True)
    done = aerodft("export", RECORDING, "-o", tmp_path / "x.xls")
    assert (done.code, ".csv, .geojson, .gpkg" in done.last) == (2, True)
