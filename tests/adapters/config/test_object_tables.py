"""``[objects]`` and tracked probes of a station: what they say, that it comes back, and what is refused."""

from pathlib import Path

import pytest

from aerodft.adapters.config.station import StationConfig, parse_station, resolved_toml
from aerodft.errors import ConfigError
from aerodft.model import PixelSource
from aerodft.service import ObjectSettings

CAMERA = '[camera]\nname = "c"\nwidth_px = 640\nheight_px = 480\nhfov_deg = 60\n'
FIXED = "[pose]\nheight_agl_m = 5\ntilt_deg = 60\n"
FLYING = "[telemetry]\n"
OBJECTS = "[objects]\nevery_s = 0.2\nmin_area_px = 90\nignore = [[[0, 0], [9, 0], [9, 9]]]\ndistances_within_m = 4\n"
BANKS = '[[probe]]\nname = "banks"\nkind = "distance"\npixels = [[10, 20], [300, 30]]\ntracked = true\n'
AT = 'at = "2026-11-21T10:00:00.5Z"\n'


def station(*parts: str, camera: str = CAMERA) -> StationConfig:
    text = '[station]\nname = "s"\n' + camera + "".join(parts)
    return parse_station(text.encode(), where="s.toml", folder=Path())


def test_objects_are_what_the_table_says_and_by_default_what_the_settings_say() -> None:
    found = station(FIXED, OBJECTS).objects
    assert found == ObjectSettings(
        every_s=0.2, min_area_px=90, ignore=(((0.0, 0.0), (9.0, 0.0), (9.0, 9.0)),), distances_within_m=4.0
    )
    assert station(FIXED, "[objects]\n").objects == ObjectSettings()
    assert station(FIXED).objects is None


@pytest.mark.parametrize(
    "parts", [(FIXED, OBJECTS), (FLYING, BANKS), (FLYING, BANKS, 'at = "2026-11-21T10:00:00.5Z"\n')]
)
def test_the_resolved_text_says_the_same(parts: tuple[str, ...]) -> None:
    first = station(*parts)
    again = parse_station(resolved_toml(first).encode(), where="again", folder=first.record.folder)
    assert again.objects == first.objects
    assert again.pipeline.probes == first.pipeline.probes
    assert again.pipeline.config_id == first.pipeline.config_id


def test_what_decides_only_what_is_seen_is_not_in_the_configuration_s_id() -> None:
    first = station(FIXED, OBJECTS).pipeline.config_id
    assert station(FIXED, OBJECTS.replace("min_area_px = 90", "min_area_px = 40")).pipeline.config_id == first
    assert station(FIXED, OBJECTS + "acceleration_mps2 = 2\n").pipeline.config_id != first


def test_a_tracked_probe_has_pixels_of_the_first_image_or_of_its_time() -> None:
    (first,) = station(FLYING, BANKS).pipeline.probes
    assert (first.source, first.at_ns, first.pixels) == (PixelSource.TRACKED, None, ((10.0, 20.0), (300.0, 30.0)))
    (later,) = station(FLYING, BANKS, AT).pipeline.probes
    assert later.at_ns == 1795255200500000000


@pytest.mark.parametrize(
    ("parts", "sentence"),
    [
        ((FIXED, "[objects]\nmin_area_px = 0\n"), "objects.min_area_px"),
        ((FIXED, "[objects]\ncolour = 1\n"), "objects.colour"),
        ((FIXED, "[objects]\n", BANKS.replace("tracked = true\n", "").replace("banks", "object-1")), "another name"),
        ((FIXED, BANKS), "a fixed camera's pixels stay, or follow its turns with"),
        ((FLYING, BANKS, "observed = true\n"), "one of the two"),
        ((FLYING, BANKS.replace("tracked = true\n", ""), 'at = "2026-11-21T10:00:00Z"\n'), "without tracked = true"),
        ((FLYING, BANKS.replace("distance", "track")), r'kind: got "track"'),
        ((FLYING, BANKS.replace("[10, 20], ", "")), "got 1 pixel"),
    ],
)
def test_what_makes_no_sense_is_refused_in_a_sentence(parts: tuple[str, ...], sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        station(*parts)


def test_the_paper_s_equations_follow_no_objects() -> None:
    with pytest.raises(ConfigError, match=r"objects: it stands beside camera.model"):
        station(FIXED, "[objects]\n", camera=CAMERA + 'model = "dft"\n')


def test_aerodft_or_a_detector_of_one_s_own_looks_from_a_camera_that_moves() -> None:
    tables = "[objects]\n", "[objects]\ndetect = false\n"
    found = [station(FLYING, table).objects for table in tables]
    assert [each is not None and each.detect for each in found] == [True, False]
