"""A flight is measured alike, to the last byte, whether the compiler is loaded at once, in the middle or never."""

import os
import subprocess
import sys
from pathlib import Path

from mcap.reader import make_reader

SAMPLE = Path(__file__).parents[2] / "samples/copter.tlog"
STATION = """
[station]
name = "far"
[camera]
file = "camera.toml"
[telemetry.height]
order = ["home"]
[images]
rate_hz = 4.0
[[probe]]
name = "centre"
kind = "position"
pixels = [[320, 240]]
[[probe]]
name = "across"
kind = "width"
pixels = [[100, 300], [500, 310]]
[[probe]]
name = "staff"
kind = "height"
pixels = [[320, 300], [320, 250]]
[[probe]]
name = "far"
kind = "position"
pixels = [[320, 5]]
"""
IMPORT = """
import sys
from aerodft.cli.main import main
from aerodft.geometry import jit
if sys.argv.pop(1) == "soon":
    jit._PATIENCE, jit._PATIENCE_A_SECOND = 20_000, 0
elif sys.argv[-1].endswith("at-once"):
    jit.load_compiler()
try:
    main()
finally:
    print("compiled" if jit.is_loaded() else "as written", file=sys.stderr)
"""


def imported(folder: Path, when: str) -> tuple[str, list[tuple[str, int, bytes]]]:
    """Whether the compiler was loaded; and all data messages."""
    line = ["import", SAMPLE, "-c", folder / "station.toml", "-o", folder / when]
    variables = {**os.environ, "NUMBA_DISABLE_JIT": "1" if when == "never" else "0"}
    command = [sys.executable, "-c", IMPORT, when, *map(str, line)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=250, env=variables)
    with (folder / when / "data_000.mcap").open("rb") as file:
        messages = make_reader(file).iter_messages(log_time_order=False)
        return done.stderr.split("\n")[-2], [(each.topic, said.log_time, said.data) for _, each, said in messages]


def test_a_flight_is_measured_alike(tmp_path: Path) -> None:
    (tmp_path / "camera.toml").write_text('name = "far"\nwidth_px = 640\nheight_px = 480\nhfov_deg = 60.0\n')
    (tmp_path / "station.toml").write_text(STATION)
    answers = {when: imported(tmp_path, when) for when in ("late", "soon", "at-once", "never")}
    loaded = {when: answer[0] for when, answer in answers.items()}
    assert loaded == {"late": "as written", "soon": "compiled", "at-once": "compiled", "never": "as written"}
    messages = answers["late"][1]
    assert sum(b'"ok"' in data for topic, _, data in messages if "measurement" in topic) > 100
    for when in ("soon", "at-once", "never"):
        assert answers[when][1] == messages, when
