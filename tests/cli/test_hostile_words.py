"""Words and numbers on the command line that nobody means, and some do: each has one sentence or an honest answer."""

import shutil

import pytest

CAMERA = 'name = "c"\nwidth_px = 64\nheight_px = 48\nhfov_deg = 60.0\n'


@pytest.fixture
def measured(aerodft, tmp_path):
    camera = tmp_path / "camera.toml"
    camera.write_text(CAMERA)

    def run(*more):
        return aerodft("measure", "--camera", camera, "--height", 10, "--tilt", 40, *more)

    return run


@pytest.mark.parametrize("name", ["[/red]", "[red]x[/red]", ":smile:"])
def test_a_name_is_shown_as_it_is(measured, name):
    done = measured("--probe", f"range 31,40 name={name}")
    assert done.code == 0, done.err
    assert name in done.out.decode()


@pytest.mark.parametrize(
    "std", ["height=1e300", "position=1e200", "tilt=1e300", "focal=1e300", "elevation=1e200", "px=1e300"]
)
def test_stds_beyond_all_measure_are_refused(measured, std):
    done = measured("--std", std, "--probe", "range 31,40", "--json")
    assert (done.code, done.out) == (2, b"")
    assert done.last.startswith(f"aerodft: --std {std}: got '1e")


@pytest.mark.parametrize("std", ["height=1e12", "tilt=1e12", "focal=1e12", "elevation=1e12", "px=1e12"])
def test_the_largest_std_is_no_answer(measured, std):
    done = measured("--std", std, "--probe", "range 31,40", "--json")
    assert done.code == 4
    assert done.json[0]["status"] == "ILL_CONDITIONED"


def test_a_sentence_is_one_line(aerodft, tmp_path):
    done = aerodft("measure", "--camera", tmp_path / "a\nb\x1b[31m", "--height", 1, "--tilt", 2, "--probe", "range 1,1")
    assert done.code == 3
    assert done.err.splitlines() == [f"aerodft: {tmp_path}/a\\nb\\x1b[31m: no such file; check the path"]


def test_a_file_with_control_characters_in_its_name_does_not_reach_the_terminal_by_init(aerodft, desk, tmp_path):
    log = tmp_path / "a\x1b[31m\x07.tlog"
    shutil.copy(desk.log, log)
    done = aerodft("init", log, "-o", tmp_path / "new\x1b[31m")
    assert done.code == 0, done.err
    assert "new\\x1b[31m/station.toml" in done.out.decode()
    assert not any(character < " " for character in (done.out.decode() + done.err).replace("\n", ""))


@pytest.mark.parametrize("seconds", ["-1", "nan", "inf", "1e300"])
@pytest.mark.parametrize("command", [("serve", "x.toml"), ("doctor", "udpin:127.0.0.1:0")])
def test_a_wait_is_some_time_and_ends(aerodft, command, seconds):
    done = aerodft(*command, "--seconds", seconds)
    assert (done.code, done.out) == (2, b"")
    assert ": --seconds: got " in done.last
