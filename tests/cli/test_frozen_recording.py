"""A recording of version 0.1, written by the stock writer: it opens, replays and gives its numbers again for ever.

If this fails, aerodft cannot read what it once wrote, or computes something else from it. Neither is to be mended here.
What a number is worth, and whether it is refused, may become known better: that is a change that CHANGELOG states, and
``python -m tests.cli.test_frozen_recording`` then writes ``frozen-0.1-expected.jsonl`` anew.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import orjson
import pytest

from aerodft.adapters.recording.recover import recover_folder
from aerodft.model import Image
from replay.recordings import Recording, RecordingSource
from tests.ports import free_endpoint

FROZEN = Path(__file__).parent / "frozen-0.1"
EXPECTED = Path(__file__).parent / "frozen-0.1-expected.jsonl"
RUN_DEPENDENT = {"software"}
NUMBERS = ("value", "ground_m", "enu_m", "range_m")


def measured(folder: Path) -> dict[tuple[str, str], dict[str, object]]:
    return {(each["name"], each["stamp_ns"]): each for each in map(orjson.loads, Recording(folder).measurements())}


def test_it_gives_its_numbers_again(aerodft, tmp_path: Path) -> None:
    done = aerodft("recompute", FROZEN, "-o", tmp_path / "again")
    assert done.code == 0, done.err
    then, now = measured(FROZEN), measured(tmp_path / "again")
    assert then.keys() == now.keys()
    assert len(then) == 118
    compared = 0
    for key, old in then.items():
        new = now[key]
        # What a number is worth may be known better later, and so whether it is worth anything; the number stays.
        if "ILL_CONDITIONED" in {old["status"], new["status"]}:
            continue
        assert new["status"] == old["status"], key
        for name in NUMBERS:
            assert flat(new[name]) == pytest.approx(flat(old[name]), rel=1e-9, abs=1e-9), (key, name)
        compared += old["status"] == "ok"
    assert compared > 50


def test_stds_intervals_refusals_and_all_else_stay_too(aerodft, tmp_path: Path) -> None:
    """Every key of every measurement, those without an answer included, against what was last said to be right."""
    assert aerodft("recompute", FROZEN, "-o", tmp_path / "again").code == 0
    now = [told(each) for each in measured(tmp_path / "again").values()]
    expected = [orjson.loads(line) for line in EXPECTED.read_bytes().splitlines()]
    assert len(now) == len(expected) == 118
    for new, old in zip(now, expected, strict=True):
        assert_same(new, old, f"{old['name']} at {old['stamp_ns']}")
    assert {each["status"] for each in expected} > {"ok"}, "some are refused"
    assert sum(each["std"] is not None or each["ellipse95"] is not None for each in expected) > 50


def told(measurement: dict[str, object]) -> dict[str, object]:
    return {key: value for key, value in measurement.items() if key not in RUN_DEPENDENT}


def assert_same(new: object, old: object, where: str) -> None:
    """Equal; numbers within what another processor's linear algebra may change."""
    if isinstance(old, dict):
        assert isinstance(new, dict), where
        assert list(new) == list(old), where
        for key in old:
            assert_same(new[key], old[key], f"{where}: {key}")
    elif isinstance(old, list):
        assert isinstance(new, list), where
        assert len(new) == len(old), where
        for k, (each, was) in enumerate(zip(new, old, strict=True)):
            assert_same(each, was, f"{where}[{k}]")
    elif isinstance(old, float):
        assert new == pytest.approx(old, rel=1e-9, abs=1e-9), where
    else:
        assert new == old, where


def flat(value: object) -> list[float]:
    if value is None:
        return []
    return [each for part in value for each in flat(part)] if isinstance(value, list) else [float(value)]


def test_it_replays(aerodft) -> None:
    done = aerodft("replay", FROZEN, "--rate", "max", "--listen", free_endpoint(), "--json")
    assert done.code == 0, done.err
    assert (done.json["measurements"], done.json["images"]) == (118, 6)


def test_its_images_are_found() -> None:
    source = RecordingSource(Recording(FROZEN), pixels=True)
    images = [event for event in source.events() if isinstance(event, Image)]
    seen = [image for image in images if image.pixels is not None]
    assert (len(images), len(seen)) == (30, 6)
    assert all(image.pixels().shape == (180, 320, 3) for image in seen)


def test_it_is_sound_and_recovery_leaves_it_alone(tmp_path: Path) -> None:
    shutil.copytree(FROZEN, tmp_path / "copy")
    recovery = recover_folder(tmp_path / "copy")
    assert [(each.state, each.messages) for each in recovery.segments] == [("sound", 795), ("sound", 7)]
    for path in FROZEN.iterdir():
        assert (tmp_path / "copy" / path.name).read_bytes() == path.read_bytes()


def write_expected() -> None:
    with tempfile.TemporaryDirectory() as name:
        run = [sys.executable, "-m", "aerodft", "recompute", FROZEN, "-o", Path(name) / "again"]
        subprocess.run(list(map(str, run)), check=True)
        lines = [orjson.dumps(told(each)) for each in measured(Path(name) / "again").values()]
    EXPECTED.write_bytes(b"\n".join(lines) + b"\n")


if __name__ == "__main__":
    write_expected()
