"""What people write for ``aerodft import``: configuration, observations and options, and how it is refused."""

import pytest

UTC0_NS = 1_795_221_168_000_000_000
START = "2026-11-21T00:32:48.55Z"


def refused(found, code, *said):
    """The command ended with this exit code and one sentence that says all of this."""
    assert found.code == code, found.err
    assert found.last.startswith("aerodft: ")
    for words in said:
        assert words in found.last
    assert "Traceback" not in found.err


def untouched(folder):
    assert not folder.exists(), sorted(folder.iterdir())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: t.replace("rate_hz", "rate_s"), "images.rate_s: unknown key: expected rate_hz (in hertz)"),
        (lambda t: t.replace("31.5, 23.5", "310.5, 23.5"), 'probe "centre" lies outside the image: got pixel (310.5,'),
        (lambda t: t.replace("camera.toml", "kamera.toml"), "kamera.toml: no such file"),
        (lambda _: "", "holds no keys: got an empty file"),
    ],
)
def test_a_bad_configuration_names_its_key(aerodft, desk, change, said):
    config = desk.station(change(desk.config.read_text()), "bad.toml")
    found = aerodft("import", desk.log, "-c", config, "-o", desk.folder / "out")
    refused(found, 3, said, str(desk.folder))
    assert len(found.err.strip().splitlines()) == 1
    untouched(desk.folder / "out")


def test_no_configuration_file(aerodft, desk):
    found = aerodft("import", desk.log, "-c", desk.folder / "none.toml", "-o", desk.folder / "out")
    refused(found, 3, f"{desk.folder}/none.toml: no such file")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ({"name": "width", "stamp_ns": "1", "pixel": [[1, 1]]}, "pixel: unknown key; did you mean pixels?"),
        ({"name": "width", "image": 12, "pixels": [[1, 1]]}, "no stamp is known for the image: got image 12 of 0"),
    ],
)
def test_a_malformed_observation_names_its_line(aerodft, desk, line, said):
    good = {"name": "width", "stamp_ns": str(UTC0_NS + 10**9), "pixels": [[1, 1], [2, 2]]}
    seen = desk.observations(good, line)
    found = aerodft("import", desk.log, "-c", desk.config, "-o", desk.folder / "out", "--observations", seen)
    refused(found, 3, f"{seen}:2: ", said)
    untouched(desk.folder / "out")


def test_no_observation_file(aerodft, desk):
    path = desk.folder / "none.jsonl"
    found = aerodft("import", desk.log, "-c", desk.config, "-o", desk.folder / "out", "--observations", path)
    refused(found, 3, str(path), "the observation file cannot be read")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ((), "no -o FOLDER"),
        (("-o", "OUT", "--rate", "0"), "--rate: got 0, expected above 0, at most 1000"),
        (("-o", "OUT", "--rate", "5", "--video", "VIDEO"), "--video and --rate together"),
        (("-o", "OUT", "--images", "OUT", "--video", "VIDEO"), "--video and --images together"),
        (("-o", "OUT", "--video-start", START), "--video-start without a video: expected --video"),
        (("-o", "OUT", "--video", "VIDEO", "--video-start", "noon"), "--video-start: got 'noon', expected ISO 8601"),
    ],
)
def test_options_that_make_no_sense(aerodft, desk, options, said):
    names = {"OUT": desk.folder / "out", "VIDEO": desk.folder / "flight.mp4"}
    found = aerodft("import", desk.log, "-c", desk.config, *(names.get(word, word) for word in options))
    refused(found, 2, said)
    untouched(desk.folder / "out")
