"""The command as a whole: help, version, exit codes, and errors in one sentence."""

import subprocess
import sys

import pytest

from aerodft.cli.main import COMMANDS, build_app
from aerodft.version import SOFTWARE


def process(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "aerodft", *map(str, arguments)], capture_output=True, check=False, text=True
    )


def test_version(aerodft):
    found = aerodft("--version")
    assert (found.code, found.out.decode()) == (0, f"{SOFTWARE}\n")


def test_the_help_lists_every_command(aerodft):
    found = aerodft("--help")
    assert found.code == 0
    for name, (_, line) in COMMANDS.items():
        assert name in found.out.decode()
        assert line[:20] in found.out.decode()


def test_without_a_command_there_is_help(aerodft):
    found = aerodft()
    assert found.code == 2
    assert "measure" in found.out.decode() + found.err


@pytest.mark.parametrize("name", ["measure", "import", "recompute", "doctor"])
def test_every_commands_help_has_an_example_and_json(aerodft, name):
    found = aerodft(name, "--help")
    text = found.out.decode()
    assert found.code == 0
    assert f"aerodft {name}" in text
    assert "Example:" in text or "Examples:" in text
    assert "--json" in text


@pytest.mark.parametrize(
    "arguments", [("measur",), ("measure", "--hight", "3"), ("measure", "--height", "tall"), ("recompute",)]
)
def test_a_wrong_command_line_is_exit_2_without_a_traceback(aerodft, arguments):
    found = aerodft(*arguments)
    assert found.code == 2
    assert found.out == b""
    assert "Traceback" not in found.err


def test_help_and_station_files_need_no_library_that_does_the_work():
    code = (
        "import sys; from aerodft.cli.main import COMMANDS, build_app; [build_app([name]) for name in COMMANDS];"
        "print(sorted({'av', 'cv2', 'zenoh', 'mcap', 'matplotlib', 'numba', 'scipy'} & set(sys.modules)));"
        "import aerodft.adapters.config.station;"  # which every measurement reads
        "print(sorted({'av', 'zenoh', 'mcap', 'matplotlib', 'foxglove'} & set(sys.modules)))"
    )
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert loaded.stdout == "[]\n[]\n"


def test_every_listed_command_exists():
    for name in COMMANDS:
        build_app([name])


def test_a_bug_is_not_hidden(monkeypatch, aerodft):
    def broken(*_):
        raise ZeroDivisionError

    monkeypatch.setattr("aerodft.adapters.config.camera.load_camera", broken)
    with pytest.raises(ZeroDivisionError):
        aerodft("measure", "--camera", "x", "--height", 1, "--tilt", 0, "--probe", "range 1,1")


def test_a_process_says_its_error_once_on_stderr(tmp_path):
    found = process("recompute", tmp_path / "none", "-o", tmp_path / "new")
    assert (found.returncode, found.stdout) == (3, "")
    assert found.stderr == f"aerodft: {tmp_path}/none: no such file or folder\n"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("measur",), "no such command: got measur, expected one of measure, "),
        (("calibrte", "x.toml"), "did you mean calibrate?"),
        (("--verbose", "it's"), "no such command: got it's, expected one of measure, "),
        (("measure", "--heigth", "3"), "measure: no such option: got --heigth; did you mean --height?"),
        (("measure", "--height", "tall"), "measure: --height: got tall, expected a number; see aerodft measure --help"),
        (("measure", "--height=tall"), "measure: --height: got tall, expected a number"),
        (("calibrate", "x.toml"), "calibrate: missing option '--camera'; see aerodft calibrate --help"),
        (("calibrate", "x.toml", "--camera"), "calibrate: option '--camera' requires an argument"),
        (
            ("calibrate", "x.toml", "--camera", "c", "--model", "foo"),
            "--model: got foo, expected one of 'pinhole', 'dft'",
        ),
        (("export",), "export: missing argument"),
        (("paper", "a", "b"), "paper: got unexpected extra argument"),
        (("--verbose",), "no command, expected one of measure, "),
        (("-x",), "no such option: got -x"),
    ],
)
def test_misuse_is_one_sentence_that_says_what_and_what_to_do(aerodft, arguments, sentence):
    found = aerodft(*arguments)
    assert found.code == 2
    assert found.out == b""
    assert len(found.err.strip().splitlines()) == 1
    assert found.err.startswith("aerodft: ")
    assert sentence in found.err.replace(": expected", ", expected")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_says_misuse_in_one_sentence(aerodft, name):
    found = aerodft(name, "--no-such-option")
    assert (found.code, found.out) == (2, b"")
    assert found.err.count("\n") == 1
    assert found.err.startswith(f"aerodft: {name}: no such option: got --no-such-option; ")


def test_the_shell_completes_commands_and_their_options(aerodft, monkeypatch):
    monkeypatch.setenv("_AERODFT_COMPLETE", "complete_bash")
    for words, at, found in (
        ("aerodft re", 1, {"replay", "recompute", "recover", "report"}),
        ("aerodft import --vid", 2, {"--video", "--video-start"}),
    ):
        monkeypatch.setenv("COMP_WORDS", words)
        monkeypatch.setenv("COMP_CWORD", str(at))
        said = aerodft().out.decode().split()
        assert set(said) == found


def test_the_options_of_measure_stand_in_groups(aerodft):
    said = aerodft("measure", "--help").out.decode()
    names = ("Camera and pose", "Ground", "Uncertainty and model", "Options")
    begins = [said.index(f"\n{name}:\n") for name in names]
    options = [said.index(f"\n  {name} <") for name in ("--height", "--terrain", "--model", "--probe")]
    assert sorted(begins + options) == [at for pair in zip(begins, options, strict=True) for at in pair]
