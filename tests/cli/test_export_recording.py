"""``aerodft export`` of a whole recording: one MCAP file for stock readers, and a video of what was measured."""

import re
import shutil

import av
import numpy as np
import orjson
import pytest
from mcap.reader import make_reader

from aerodft.model import Image
from aerodft.reports.style import colours_of
from replay.export import COLOURS, Overlay, best_image
from replay.export.video import label_of
from replay.recordings import Recording, RecordingSource

FOR_VIEWERS = re.compile(r"/(annotations|transform|number/[^/]+)$")


def messages(path):
    with path.open("rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False):
            yield message.log_time, channel.topic, message.data, message.sequence


@pytest.fixture(scope="module")
def merged(aerodft, flight_recording, tmp_path_factory):
    folder = tmp_path_factory.mktemp("merged")
    done = aerodft("export", flight_recording, "--format", "mcap", "-o", folder / "all.mcap", "--json")
    assert done.code == 0, done.err
    return folder / "all.mcap", done.json


def test_one_file_has_every_message_by_time_and_the_stock_reader_reads_it(flight_recording, merged):
    path, said = merged
    everything = list(messages(path))
    got = [message for message in everything if not FOR_VIEWERS.search(message[1])]
    parts = [message for part in sorted(flight_recording.glob("*.mcap")) for message in messages(part)]
    assert [at for at, *_ in got] == sorted(at for at, *_ in parts)
    assert sorted(got) == sorted(parts)
    assert said["messages"] == len(everything) > len(parts)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary.statistics.message_count == len(everything)
        assert sum(len(index.message_index_offsets) > 0 for index in summary.chunk_indexes) == len(
            summary.chunk_indexes
        )
        topics = [channel.topic for channel in summary.channels.values()]
        assert len(set(topics)) == len(topics)
        assert [each.name for each in reader.iter_attachments()] == ["config.toml"]
        names = [each.name for each in reader.iter_metadata()]
        assert "aerodft" in names
        assert len(set(names)) == len(names)


def test_it_is_the_same_recording_again(aerodft, flight_recording, merged, tmp_path):
    compared = aerodft("compare", flight_recording, merged[0], "--json")
    assert (compared.code, compared.json["identical"]) == (0, True)
    again = aerodft("recompute", merged[0], "-o", tmp_path / "again")
    assert again.code == 0, again.err
    measured = list(Recording(flight_recording).measurements())
    assert list(Recording(merged[0]).measurements()) == list(Recording(tmp_path / "again").measurements()) == measured


def test_what_is_damaged_is_left_out_and_said(aerodft, flight_recording, tmp_path):
    folder = tmp_path / "damaged"
    shutil.copytree(flight_recording, folder)
    segment = folder / "data_000.mcap"
    data = bytearray(segment.read_bytes())
    with segment.open("rb") as file:
        chunk = max(make_reader(file).get_summary().chunk_indexes, key=lambda each: each.chunk_length)
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 0xFF
    segment.write_bytes(data)
    done = aerodft("export", folder, "--format", "mcap", "-o", tmp_path / "all.mcap", "--json")
    assert (done.code, done.json["damaged_chunks"]) == (5, 1)
    assert len(list(messages(tmp_path / "all.mcap"))) == done.json["messages"]


def decoded(path):
    with av.open(str(path)) as container:
        frames = list(container.decode(video=0))
    return [frame.time for frame in frames], [frame.to_ndarray(format="rgb24") for frame in frames]


def test_a_video_shows_every_recorded_image_at_its_time(aerodft, flight_recording, tmp_path):
    path = tmp_path / "flight.mp4"
    done = aerodft("export", flight_recording, "--format", "mp4", "-o", path, "--json")
    assert done.code == 0, done.err
    events = RecordingSource(Recording(flight_recording), pixels=True).events()
    images = [event for event in events if isinstance(event, Image) and event.pixels]
    times, pictures = decoded(path)
    assert len(times) == done.json["images"] == len(images) == 2
    due = [(image.stamp_ns - images[0].stamp_ns) / 1e9 for image in images]
    np.testing.assert_allclose(times, due, atol=1.1e-5)
    assert pictures[0].shape == (480, 640, 3)  # 64 x 48 px, enlarged
    for image, picture in zip(images, pictures, strict=True):
        grey = float(np.median(image.pixels()))
        assert np.median(picture) == pytest.approx(grey, abs=6)
        assert (np.abs(picture.astype(float) - grey).max(axis=2) > 60).mean() > 0.01  # what is written


def an_item(**changes):
    pose = {"height_agl_m": 40.0, "height_source": "home", "tilt_deg": 30.0, "heading_deg": 12.0}
    item = {
        "name": "width", "kind": "distance", "status": "ok", "value": 22.712, "unit": "m", "std": 0.16,
        "ci95": [22.39, 23.03], "ellipse95": None, "pixels": [[100.0, 300.0], [500.0, 300.0]], "geo": None,
        "enu_m": None, "image": 3, "stamp_ns": "1795221278868833000", "pose": pose,
    }  # fmt: skip
    return item | changes


def test_labels_say_value_and_interval_or_why_there_is_none():
    assert label_of(an_item()) == "width  22.71 m  [22.39 … 23.03]"
    assert label_of(an_item(unit="m2", value=1234.5, ci95=[1180.0, 1290.0])) == "width  1234 m²  [1180 … 1290]"
    assert label_of(an_item(unit="deg", value=359.0, ci95=[358.2, 359.8])) == "width  359.0°  [358.2 … 359.8]"
    assert label_of(an_item(status="NO_HEIGHT", value=None, ci95=None)) == "width  NO_HEIGHT"
    ellipse = {"semi_major_m": 4.21, "semi_minor_m": 2.0, "azimuth_deg": 3.0}
    place = an_item(
        value=None, ci95=None, ellipse95=ellipse, geo=[{"lat_deg": -35.3634121, "lon_deg": 149.165, "alt_msl_m": None}]
    )
    assert label_of(place) == "width  -35.363412°, 149.165000°  ± 4.2 m (95 %)"


@pytest.mark.parametrize(("width", "height"), [(16, 12), (641, 479), (480, 1920), (3840, 2160)])
def test_labels_lie_in_the_image_and_not_on_each_other(width, height):
    overlay = Overlay(width, height)
    names = [f"a rather long name of a probe, number {number}" for number in range(6)]
    items = [an_item(name=name, pixels=[[width * 0.5, height * 0.5], [width - 1.0, height * 0.5]]) for name in names]
    items += [
        an_item(name="far", pixels=[[-9e9, 3.0]]),
        an_item(name="none", status="NO_HEIGHT", pixels=[[None, None]]),
    ]
    drawn = overlay.draw(np.full((height, width, 3), 90, dtype=np.uint8), items, 0, 3)
    assert drawn.shape == (overlay.size[1], overlay.size[0], 3)
    assert (overlay.size[0] % 2, overlay.size[1] % 2) == (0, 0)
    assert min(overlay.size[1], 480) == 480 or height >= 479
    # Each probe's colour fills its own label: none lies under another.
    counts = [int((drawn == colour).all(axis=2).sum()) for colour in overlay.colours.values()]
    assert min(counts) > 0.2 * max(counts)


def test_a_label_is_one_line_whatever_a_recording_calls_its_probe():
    blank = np.zeros((480, 640, 3), np.uint8)
    drawn = [Overlay(640, 480).draw(blank, [an_item(name=name)], 0, 0) for name in ("a\n\x1b[31m", "a\\n\\x1b[31m")]
    assert np.array_equal(*drawn)


def test_labels_leave_crosses_to_be_seen():
    overlay = Overlay(1280, 720)
    items = [
        an_item(name="bank", pixels=[[300.0, 360.0], [980.0, 340.0]]),
        an_item(name="point", pixels=[[639.0, 352.0]]),
    ]
    drawn = overlay.draw(np.full((720, 1280, 3), 90, dtype=np.uint8), items, 0, 3)
    for name, (u, v) in (("bank", (300, 360)), ("bank", (980, 340)), ("point", (639, 352))):
        assert (drawn[v, u] == overlay.colours[name]).all()
        assert (drawn[[v - 6, v + 6], u - 6] == 90).all()  # between its arms there is the image


def test_a_picture_has_the_colours_of_its_page(flight_recording):
    recording = Recording(flight_recording)
    names = [orjson.loads(each)["name"] for each in recording.measurements()]
    colours = colours_of(dict.fromkeys(names))
    assert list(colours.values())[:2] == [(0, 114, 178), (213, 94, 0)]  # as matplotlib reads them
    _, drawn = best_image(recording, colours)
    assert any((drawn == colour).all(axis=2).sum() > 50 for colour in colours.values())
    assert not any((drawn == colour).all(axis=2).any() for colour in COLOURS if colour not in colours.values())


def test_no_image_is_no_answer(aerodft, flight_recording, tmp_path):
    folder = tmp_path / "blind"
    folder.mkdir()
    for path in flight_recording.glob("data_*"):
        shutil.copy(path, folder)
    done = aerodft("export", folder, "--format", "mp4", "-o", tmp_path / "x.mp4")
    assert (done.code, "the recording holds no image" in done.last) == (4, True)
    assert not (tmp_path / "x.mp4").exists()


def test_measurements_stay_with_their_image(aerodft, flight_recording, tmp_path):
    done = aerodft("export", flight_recording, "--format", "mp4", "-o", tmp_path / "x.mp4", "--json")
    indexes = {
        event.index
        for event in RecordingSource(Recording(flight_recording), pixels=True).events()
        if isinstance(event, Image) and event.pixels
    }
    measured = [orjson.loads(payload)["image"] for payload in Recording(flight_recording).measurements()]
    assert done.json["measurements"] == sum(image in indexes for image in measured) > 0


@pytest.mark.parametrize("name", ["data_099.mcap", "all.mcap"])
def test_a_file_among_its_own_segments_is_refused(aerodft, flight_recording, tmp_path, name):
    """It would be read as one of them: the recording would then go back in time."""
    folder = tmp_path / "flight"
    shutil.copytree(flight_recording, folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    for extra in ((), ("--overwrite",)):
        done = aerodft("export", folder, "--format", "mcap", "-o", folder / name, *extra)
        assert (done.code, f"{name} among the recording's own segments" in done.last) == (2, True)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert aerodft("export", folder, "-o", folder / "widths.csv").code == 0


@pytest.mark.parametrize("form", ["csv", "geojson", "jsonl", "parquet", "mcap"])
def test_the_outputs_ending_says_what_is_written(aerodft, flight_recording, tmp_path, form):
    asked, told = tmp_path / "asked", tmp_path / f"told.{form.upper() if form == 'csv' else form}"
    assert aerodft("export", flight_recording, "--format", form, "-o", asked).code == 0
    done = aerodft("export", flight_recording, "-o", told, "--json")
    assert (done.code, done.json["format"]) == (0, form)
    assert told.read_bytes() == asked.read_bytes()


@pytest.mark.parametrize(("name", "form"), [("x.json", "geojson"), ("x.txt", "csv"), ("x", "jsonl")])
def test_a_name_that_says_nothing_is_anybodys(aerodft, flight_recording, tmp_path, name, form):
    done = aerodft("export", flight_recording, "--format", form, "-o", tmp_path / name, "--json")
    assert (done.code, done.json["format"]) == (0, form)


@pytest.mark.parametrize(
    ("name", "more", "said"),
    [
        ("x.parquet", ("--format", "csv"), ".parquet with --format csv, expected a name that ends with .csv"),
        ("x.avi", ("--format", "mp4"), ".avi with --format mp4, expected a name that ends with .mp4"),
        ("x.json", (), ".json, expected one of .csv, .geojson, .gpkg, .kml, .jsonl, .parquet, .mcap, .mp4"),
        ("x.shp", (), ".shp, expected one of .csv, .geojson, .gpkg, .kml, .jsonl, .parquet, .mcap, .mp4"),
    ],
)
def test_a_name_that_says_something_else_is_refused(aerodft, flight_recording, tmp_path, name, more, said):
    done = aerodft("export", flight_recording, *more, "-o", tmp_path / name)
    assert done.code == 2
    assert said in done.err
    assert not (tmp_path / name).exists()
