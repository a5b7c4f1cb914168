"""Image segments that a recompute copied: damage is said with what it cost, and recovered files can be read."""

import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader

from aerodft.adapters.recording.write import recorder
from tests.cli.conftest import CAMERA, STATION, Desk
from tests.commands import run_aerodft
from tests.nights import at_night

COPIES = [f"images_{number:03d}.mcap" for number in range(1, 5)]
CUTS = [0.05, 0.1, 0.3, 0.4, 0.7, 0.85, 0.95, 0.99]

Damage = Callable[[Path], object]


@pytest.fixture(scope="module")
def recomputed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording with copies of four image segments of a second each."""
    desk = Desk(tmp_path_factory.mktemp("copies"))
    (desk.folder / "camera.toml").write_text(CAMERA)
    config = desk.station(f"[record]\nsegment_s = 1\nimage_hz = 5\n{STATION}")
    video = ("--video", desk.video(images=17), "--video-start", "2026-11-21T00:32:48.05Z")
    assert run_aerodft("import", desk.tlog(seconds=4.0), *video, "-c", config, "-o", desk.folder / "flight").code == 0
    assert run_aerodft("recompute", desk.folder / "flight", "-o", desk.folder / "again").code == 0
    assert sorted(path.name for path in (desk.folder / "again").glob("images_*")) == ["images_000.mcap", *COPIES]
    return desk.folder / "again"


def stock_messages(path: Path) -> Iterator[tuple[int, bytes]]:
    """What the stock reader reads, with its checks on."""
    with path.open("rb") as file:
        for _, _, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False):
            yield message.log_time, message.data


def images(folder: Path) -> Counter[tuple[int, bytes]]:
    return Counter(message for path in folder.glob("images_*.mcap") for message in stock_messages(path))


def check(recomputed: Path, folder: Path, damage: Damage, *, is_missing: bool = False) -> int:
    """Damage a copy of the recording and recover it; returns how many messages were lost."""
    shutil.copytree(recomputed, folder)
    whole = images(folder)
    damage(folder)
    export = ("export", folder, "--format", "mcap", "-o", folder.with_suffix(".mcap"), "--json")
    read = run_aerodft(*export)
    done = run_aerodft("recover", folder, "--json")
    lost = sum((whole - images(folder)).values())  # every file opens in the stock reader
    assert (read.code, done.code) == (5, 5) if lost else (0, 0), done.err
    losses = [loss["messages"] for segment in done.json["segments"] for loss in segment["losses"]]
    assert sum(losses) == lost, done.err
    again = run_aerodft("recover", folder, "--json")
    assert again.code == (5 if is_missing else 0), again.err
    assert run_aerodft(*export, "--overwrite").code == (5 if is_missing else 0), "what is lost was said"
    return lost


@pytest.mark.parametrize("share", [0.0, 0.5, 0.999, *at_night(*CUTS)])
@pytest.mark.parametrize("name", [COPIES[1], COPIES[-1], *at_night(COPIES[0], COPIES[2])])
def test_a_cut_copy_is_recovered_and_its_loss_said(recomputed: Path, tmp_path: Path, name: str, share: float) -> None:
    def cut(folder: Path) -> None:
        content = (folder / name).read_bytes()
        (folder / name).write_bytes(content[: int(len(content) * share)])

    lost = check(recomputed, tmp_path / "cut", cut)
    held = sum(1 for _ in stock_messages(recomputed / name))
    assert lost == held if share < 0.3 else lost > 0 if share == 0.5 else lost <= held


@pytest.mark.parametrize("name", [COPIES[0], *at_night(*COPIES[1:])])
@pytest.mark.parametrize("seed", [0, *at_night(*range(1, 8))])
def test_a_flipped_bit_in_a_copy_costs_what_is_said(recomputed: Path, tmp_path: Path, name: str, seed: int) -> None:
    def flip(folder: Path) -> None:
        draws, content = np.random.default_rng(seed), bytearray((folder / name).read_bytes())
        content[draws.integers(len(content))] ^= 1 << draws.integers(8)
        (folder / name).write_bytes(content)

    check(recomputed, tmp_path / "flipped", flip)


@pytest.mark.parametrize("digit", [-7, -30, *at_night(-2, -18, -29, -40)])
def test_a_flipped_digit_of_a_count_is_no_loss(recomputed: Path, tmp_path: Path, digit: int) -> None:
    """Counts have no checksum: of chunks and messages only one can be damaged by one flipped bit."""

    def flip(folder: Path) -> None:
        content = bytearray((folder / COPIES[0]).read_bytes())
        end = content.rfind(b"messages\x0f") + len(b"messages\x0f") + 3 + 15  # of the last count, behind all chunks
        content[end + digit] ^= 1
        (folder / COPIES[0]).write_bytes(content)

    assert check(recomputed, tmp_path / "flipped", flip) == 0


@pytest.mark.parametrize("name", [COPIES[0], COPIES[-1], *at_night(COPIES[1])])
def test_a_missing_copy_is_named_with_what_it_held(recomputed: Path, tmp_path: Path, name: str) -> None:
    lost = check(recomputed, tmp_path / "missing", lambda folder: (folder / name).unlink(), is_missing=True)
    assert lost == sum(1 for _ in stock_messages(recomputed / name))


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (COPIES[0], COPIES[1]),
        ("images_000.mcap", COPIES[-1]),
        *at_night((COPIES[1], COPIES[3]), ("data_000.mcap", "data_001.mcap")),
    ],
)
def test_swapped_segments_lose_nothing_and_say_so(
    recomputed: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture, first: str, second: str
) -> None:
    def swap(folder: Path) -> None:
        (folder / first).rename(folder / "third")
        (folder / second).rename(folder / first)
        (folder / "third").rename(folder / second)

    assert check(recomputed, tmp_path / "swapped", swap) == 0
    assert f"{first}: its counts say that it is {second}; it is read in that place" in caplog.text


@pytest.mark.parametrize("share", [1.0, 0.6])
def test_a_duplicate_is_left_alone(recomputed: Path, tmp_path: Path, share: float) -> None:
    def duplicate(folder: Path) -> None:
        content = (folder / COPIES[1]).read_bytes()
        (folder / "images_005.mcap").write_bytes(content[: int(len(content) * share)])

    shutil.copytree(recomputed, tmp_path / "twice")
    duplicate(tmp_path / "twice")
    content = (tmp_path / "twice" / "images_005.mcap").read_bytes()
    done = run_aerodft("recover", tmp_path / "twice", "--json")
    assert (done.code, done.json["is_lossy"]) == (0, False)
    assert {"images_005.mcap": "copy"}.items() <= {s["name"]: s["state"] for s in done.json["segments"]}.items()
    assert (tmp_path / "twice" / "images_005.mcap").read_bytes() == content


def test_copies_that_an_earlier_version_did_not_list_are_recovered(
    recomputed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder, "copied_metadata", lambda _: {})
    assert run_aerodft("recompute", recomputed.parent / "flight", "-o", tmp_path / "unlisted").code == 0
    path = tmp_path / "unlisted" / COPIES[1]
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(McapError):
        list(stock_messages(path))
    done = run_aerodft("recover", tmp_path / "unlisted", "--json")
    assert done.code == 5, done.err
    assert list(stock_messages(path))
