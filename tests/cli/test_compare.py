"""``aerodft compare`` on recordings: pairs after another time offset, tables, plots and exit codes."""

import pytest

from aerodft.adapters.images import decode_jpeg


@pytest.fixture(scope="module")
def late(aerodft, flight_recording, tmp_path_factory):
    """The flight 0.1 m higher, all stamps one image period later: but for the last, each is that of another image."""
    folder = tmp_path_factory.mktemp("late")
    text = (flight_recording / "config.toml").read_text()
    (folder / "other.toml").write_text(
        text.replace("time_offset_s = 0.0", "time_offset_s = 0.2").replace(
            "home_above_plane_m = 0.0", "home_above_plane_m = 0.1"
        )
    )
    run = aerodft("recompute", flight_recording, "-c", folder / "other.toml", "-o", folder / "out")
    assert run.code == 0, run.err
    return folder / "out"


def test_a_time_offset_leaves_the_pairs_as_they_are(aerodft, flight_recording, late):
    run = aerodft("compare", flight_recording, late, "--json", "--tolerance", "1m")
    got = run.json
    assert (run.code, got["differs"]) == (0, False), run.err
    assert (got["paired_by"], got["same_input"], got["identical"]) == ("image", True, False)
    assert (got["common"], got["only_first"], got["only_second"]) == (15, 0, 0)
    assert got["shift_s"] == pytest.approx(0.2)
    by_stamp = aerodft("compare", flight_recording, late, "--json", "--pair", "stamp").json
    assert (by_stamp["paired_by"], by_stamp["only_first"] > 0) == ("stamp", True)
    tables = [late.parent / f"{name}.csv" for name in "ab"]
    for recording, table in zip((flight_recording, late), tables, strict=True):
        assert aerodft("export", recording, "-o", table).code == 0
    assert aerodft("compare", *tables, "--json", "--pair", "image", "--tolerance", "1m").json["common"] == 15


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_a_table_is_as_good_as_its_recording(aerodft, flight_recording, tmp_path, form):
    table = tmp_path / f"x.{form}"
    assert aerodft("export", flight_recording, "--format", form, "-o", table).code == 0
    for pair in ((table, flight_recording), (flight_recording, table), (table, table)):
        run = aerodft("compare", *pair, "--json")
        assert (run.code, run.json["common"], run.json["total"]["count"]) == (0, 15, 15), run.err
        assert run.json["identical"] is (pair[0] == pair[1])


def test_what_is_no_table_is_refused_in_a_sentence(aerodft, flight_recording, tmp_path):
    for name, data in (
        ("a.csv", b"x,y\n1,2\n"),
        ("b.csv", b"\xff\xfe"),
        ("c.parquet", b"PAR1"),
        ("d.csv", aerodft("export", flight_recording).out.replace(b",ok,", b",fine,")),
        ("e.csv", aerodft("export", flight_recording).out.replace(b",ok,", b",ok,x")),
    ):
        (tmp_path / name).write_bytes(data)
        run = aerodft("compare", flight_recording, tmp_path / name)
        assert (run.code, run.out, run.err.count("\n")) == (3, b"", 1), (name, run.err)


def test_a_plot_is_drawn_and_never_over_another_file(aerodft, flight_recording, late, tmp_path):
    plot = tmp_path / "plot.png"
    run = aerodft("compare", flight_recording, late, "-o", plot)
    assert run.code == 5
    height, width, _ = decode_jpeg(plot.read_bytes(), "plot").shape
    assert min(height, width) > 400
    refused = aerodft("compare", flight_recording, late, "-o", plot)
    assert (refused.code, "add --overwrite" in refused.last) == (3, True)
    first = plot.read_bytes()
    assert aerodft("compare", flight_recording, late, "-o", plot, "--overwrite").code == 5
    assert plot.read_bytes() == first  # the same again, to the byte
    assert aerodft("compare", flight_recording, late, "-o", tmp_path / "plot.jpeg2").code == 2


def test_probes_of_one_name_and_several_kinds_are_kept_apart(aerodft, flight_recording, tmp_path):
    table = tmp_path / "x.csv"
    table.write_bytes(aerodft("export", flight_recording).out.replace(b",centre,range,", b",centre,height,"))
    run = aerodft("compare", flight_recording, table, "--json")
    assert (run.code, sorted(run.json["probes"])) == (5, ["centre (height, m)", "centre (range, m)", "width"])
    assert (run.json["common"], run.json["only_first"], run.json["only_second"]) == (5, 10, 10)


def test_it_says_what_it_did(aerodft, flight_recording, late):
    run = aerodft("compare", flight_recording, late)
    assert "paired by image; the second's stamps are +0.200000 s off the first's" in run.err
    assert "stds are combined as if the two were independent" in run.err
    assert run.last == "15 in both, 0 in the first alone, 0 in the second alone: different"
