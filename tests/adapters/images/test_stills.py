import logging
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image as PillowImage
from PIL.ExifTags import IFD, Base

from aerodft.adapters.images import StillsFolderSource
from aerodft.adapters.images.stills import NamePattern
from aerodft.errors import ConfigError, InputError
from aerodft.model import Image

MARKERS = Path(__file__).parents[3].parent / "shared" / "data" / "landmarks" / "markers"
NOON_NS = 1_795_226_246_000_000_000  # 2026-11-21T01:57:26Z


def still(
    path: Path, *, date: str = "", fraction: str = "", zone: str = "", grey: int = 90, thumbnail: bool = False
) -> Path:
    image = PillowImage.fromarray(np.full((30, 40, 3), grey, dtype=np.uint8))
    exif = PillowImage.Exif()
    details = exif.get_ifd(IFD.Exif)
    for tag, value in (
        (Base.DateTimeOriginal, date),
        (Base.SubsecTimeOriginal, fraction),
        (Base.OffsetTimeOriginal, zone),
    ):
        if value:
            details[tag] = value
    if thumbnail:
        details[Base.MakerNote] = b"\xff\xd8 a whole thumbnail \xff\xda \xff\xd9"
    image.save(path, exif=exif)
    return path


def images_of(source: StillsFolderSource) -> list[Image]:
    return list(source.events())


def test_exif_gives_stamps_in_order(tmp_path: Path) -> None:
    still(tmp_path / "a.jpg", date="2026:11:21 02:57:27", fraction="25", zone="+01:00", grey=60)
    still(tmp_path / "b.jpg", date="2026:11:21 01:57:26", fraction="0459", zone="+00:00", grey=120)
    (tmp_path / "notes.txt").write_text("not a still")
    images = images_of(StillsFolderSource(tmp_path))
    assert [image.stamp_ns - NOON_NS for image in images] == [45_900_000, 1_250_000_000]
    assert [image.arrival_ns for image in images] == [image.stamp_ns for image in images]
    assert [(image.index, image.width_px, image.height_px) for image in images] == [(0, 40, 30), (1, 40, 30)]
    assert images[0].pixels is not None
    pixels = images[0].pixels()
    assert pixels.shape == (30, 40, 3)
    np.testing.assert_allclose(pixels, 120, atol=2)
    assert not pixels.flags.writeable


def test_an_offset_that_exif_does_not_state_is_assumed_aloud(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for name in "abc":
        still(tmp_path / f"{name}.jpg", date="2026:11:21 01:57:26")
    with caplog.at_level(logging.WARNING):
        assert images_of(StillsFolderSource(tmp_path))[0].stamp_ns == NOON_NS
    assert caplog.text.count("UTC assumed") == 1
    caplog.clear()
    shifted = StillsFolderSource(tmp_path, utc_offset="-02:30")
    assert shifted.span_ns == (NOON_NS + 9_000_000_000_000,) * 2
    assert len(shifted) == 3
    assert "assumed" not in caplog.text


def test_a_real_photo_has_the_stamp_that_its_name_says() -> None:
    if not MARKERS.exists():
        pytest.skip("needs ../shared/data/landmarks/markers")
    by_exif = images_of(StillsFolderSource(MARKERS, utc_offset="+01:00", decode=False))
    by_name = images_of(StillsFolderSource(MARKERS, pattern="%Y%m%d_%H%M%S", utc_offset="+01:00"))
    assert by_exif[0].stamp_ns == by_name[0].stamp_ns + 45_900_000
    assert by_name[0].stamp_ns == int(datetime(2019, 10, 29, 10, 4, 29, tzinfo=UTC).timestamp()) * 10**9
    assert by_exif[0].pixels is None
    assert by_name[0].pixels is not None
    assert by_name[0].pixels().shape == (by_name[0].height_px, by_name[0].width_px, 3)


@pytest.mark.parametrize(
    ("pattern", "name", "stamp_ns"),
    [
        ("IMG_%Y%m%d_%H%M%S_%f.jpg", "IMG_20261121_015726_5.jpg", NOON_NS + 500_000_000),
        ("IMG_%Y%m%d_%H%M%S_%f", "img_20261121_015726_000000001.JPG", NOON_NS + 1),
        ("%Y-%m-%dT%H.%M.%S%z", "2026-11-21T03.57.26+0200.png", NOON_NS),
        ("%Y%m%d", "20261121.png", NOON_NS - 7046 * 10**9),
        ("cam*-{unix_ns}.png", "cam-left-1795226246000000007.png", NOON_NS + 7),
        ("{unix_ms}", "1795226246123.tif", NOON_NS + 123_000_000),
        ("{unix_s}", "1795226246.25.jpg", NOON_NS + 250_000_000),
        ("{unix_s}", "1795226246.jpg", NOON_NS),
        ("100%%_{unix_s}(1).jpg", "100%_1795226246(1).jpg", NOON_NS),
        ("{unix_s}", "later.jpg", None),
        ("%Y%m%d", "20261341.jpg", None),
        ("%Y%m%d_%H", "20261121_25.jpg", None),
    ],
)
def test_a_file_name_tells_the_time(pattern: str, name: str, stamp_ns: int | None) -> None:
    assert NamePattern(pattern).stamp_ns(name) == stamp_ns


@given(when=st.datetimes(datetime(1970, 1, 2), datetime(2200, 1, 1), timezones=st.just(UTC)))  # noqa: DTZ001 (hypothesis adds the zone)
def test_what_strftime_writes_a_pattern_reads(when: datetime) -> None:
    text = "a-%Y%m%d-%H%M%S-%f.png"
    epoch = datetime(1970, 1, 1, tzinfo=UTC)
    micros = (when - epoch).days * 86_400_000_000 + (when - epoch).seconds * 1_000_000 + when.microsecond
    assert NamePattern(text).stamp_ns(when.strftime(text)) == micros * 1000


@pytest.mark.parametrize(
    ("pattern", "sentence"),
    [
        ("IMG_%q", "IMG_%q: pattern of file names: got %q, expected one of %Y, %m,"),
        ("IMG_{unix}", "got {unix}, expected one of %Y, "),
        ("IMG_%H%M", "IMG_%H%M: pattern of file names: got no date, expected %Y, %m and %d, or one of {unix_s}, ..."),
        ("%Y%m%d%Y", "got a field twice, expected each once"),
    ],
)
def test_a_pattern_that_makes_no_sense_is_refused(pattern: str, sentence: str) -> None:
    with pytest.raises(ConfigError) as caught:
        NamePattern(pattern)
    assert sentence in str(caught.value)


def test_what_cannot_be_read_is_left_out_and_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    good = still(tmp_path / "0001.jpg", thumbnail=True)
    data = good.read_bytes()
    (tmp_path / "0002.jpg").write_bytes(data[: len(data) - 40])
    (tmp_path / "0003.jpg").write_bytes(b"")
    (tmp_path / "0004.jpg").write_text("text")
    still(tmp_path / "0005.png")
    png = (tmp_path / "0005.png").read_bytes()
    (tmp_path / "0006.png").write_bytes(png[: len(png) - 30])
    still(tmp_path / "later.jpg")
    with caplog.at_level(logging.WARNING):
        images = images_of(StillsFolderSource(tmp_path, pattern="{unix_s}"))
    assert [image.stamp_ns for image in images] == [10**9, 5 * 10**9]
    for name, reason in (
        ("0002.jpg", "cut off or damaged"),
        ("0003.jpg", "not a readable image but an empty file"),
        ("0004.jpg", "not a readable image but text"),
        ("0006.png", "cut off or damaged"),
        ("later.jpg", "name does not match {unix_s}"),
    ):
        assert f"{tmp_path / name}: left out, {reason}" in caplog.text


def test_a_still_outlives_its_file(tmp_path: Path) -> None:
    path = still(tmp_path / "1.png", grey=33)
    image = images_of(StillsFolderSource(tmp_path, pattern="{unix_s}"))[0]
    path.unlink()
    assert image.pixels is not None
    assert (image.pixels() == 33).all()


def test_pixels_are_as_stored_whatever_the_rotation_flag(tmp_path: Path) -> None:
    path = tmp_path / "1.jpg"
    exif = PillowImage.Exif()
    exif[Base.Orientation] = 6
    PillowImage.fromarray(np.zeros((30, 40, 3), dtype=np.uint8)).save(path, exif=exif)
    image = images_of(StillsFolderSource(tmp_path, pattern="{unix_s}"))[0]
    assert image.pixels is not None
    assert image.pixels().shape == (30, 40, 3)
    assert np.asarray(cv2.imread(str(path))).shape == (40, 30, 3)


@pytest.mark.parametrize(
    ("pattern", "sentence"),
    [
        (None, "none of 1 stills has a stamp: got for instance x.jpg, expected EXIF dates; give a file name pattern"),
        ("{unix_s}", "expected names like {unix_s}; give a file name pattern such as IMG_%Y%m%d"),
    ],
)
def test_a_folder_without_a_single_stamp_is_refused(tmp_path: Path, pattern: str | None, sentence: str) -> None:
    still(tmp_path / "x.jpg", date="    :  :     :  :  ")
    with pytest.raises(InputError) as caught:
        StillsFolderSource(tmp_path, pattern=pattern)
    assert sentence in str(caught.value)


def test_no_folder_or_an_empty_one_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds no stills: expected files named \.bmp, \.jpeg"):
        StillsFolderSource(tmp_path)
    path = still(tmp_path / "x.jpg")
    with pytest.raises(InputError, match="no folder of stills: got a JPEG image, expected a folder"):
        StillsFolderSource(path)
    with pytest.raises(InputError, match="no folder of stills: got nothing there, expected a folder"):
        StillsFolderSource(tmp_path / "absent")
