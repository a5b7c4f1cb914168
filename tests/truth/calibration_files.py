"""The real ``aerodft calibrate`` on files that a test writes."""

import io
import json
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import tomli_w

from aerodft.cli.main import main
from aerodft.model.evidence import (
    GroundLines,
    GroundPoint,
    Horizon,
    KnownHeight,
    KnownLength,
    Landmark,
    SlantRange,
    Vertical,
)


@dataclass(frozen=True, slots=True)
class Answer:
    """What a command said: its exit code, its JSON document (None where it printed none) and its last words."""

    code: int
    document: dict | None
    words: str

    def value(self, name):
        return self.document["parameters"][name]["value"]


def write_camera(path: Path, camera) -> Path:
    """A camera file; coefficients are OpenCV's."""
    keys = ("name", "width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")
    table = {key: getattr(camera, key) for key in keys} | {"lens": str(camera.lens)}
    path.write_text(tomli_w.dumps(table | {"distortion": [*map(float, camera.distortion)]}))
    return path


def write_evidence(path: Path, **tables) -> Path:
    """A file of evidence."""
    path.write_text(tomli_w.dumps(tables))
    return path


def write_landmarks(path: Path, points_m, pixels, std_px) -> Path:
    """Landmarks p1, p2, ... as CSV."""
    rows = [
        ",".join([f"p{index + 1}", *(repr(float(value)) for value in (*pixel, *point)), repr(float(std_px))])
        for index, (point, pixel) in enumerate(zip(points_m, pixels, strict=True))
    ]
    path.write_text("\n".join(["name,u,v,X,Y,Z,std_px", *rows]) + "\n")
    return path


def aerodft(*arguments) -> Answer:
    """Run a command with ``--json`` in a process of its own."""
    command = [sys.executable, "-m", "aerodft", *map(str, arguments), "--json"]
    done = subprocess.run(command, capture_output=True, check=False, timeout=120)
    return Answer(done.returncode, json.loads(done.stdout) if done.stdout else None, done.stderr.decode().strip())


def aerodft_here(*arguments) -> Answer:
    """The same in this process, where a test has many of them."""
    out, err, code = io.TextIOWrapper(io.BytesIO()), io.TextIOWrapper(io.BytesIO()), 0
    argv = ["aerodft", *map(str, arguments), "--json"]
    with redirect_stdout(out), redirect_stderr(err), patch.object(sys, "argv", argv):
        try:
            main()
        except SystemExit as ending:
            code = ending.code if isinstance(ending.code, int) else 1
    out.flush()
    err.flush()
    said = out.buffer.getvalue()
    return Answer(code, json.loads(said) if said else None, err.buffer.getvalue().decode().strip())


def tables(evidence) -> dict:
    """Observations as a file of evidence has them; of each kind a list."""
    found = {}
    for each in evidence:
        kind, table = _TABLES[type(each)](each)
        found.setdefault(kind, []).append({"name": each.name, "std_px": each.std_px, **table})
    return found


def _landmark(each):
    place = ["?" if value is None else value for value in each.position_m]
    return "landmark", {"pixel": each.pixel, "position_m": place, "std_m": each.std_m}


def _lines(each):
    kind = "right_angle" if each.at_right_angle else "parallel"
    return kind, {"lines": [each.first, each.second]}


_TABLES = {
    Landmark: _landmark,
    SlantRange: lambda each: ("range", {"pixel": each.pixel, "range_m": each.range_m, "std_m": each.std_m}),
    GroundPoint: lambda each: ("ground", {"pixel": each.pixel, "xy_m": each.xy_m, "std_m": each.std_m}),
    KnownLength: lambda each: (
        "length",
        {"pixels": each.pixels, "length_m": each.length_m, "elevation_m": each.elevation_m, "std_m": each.std_m},
    ),
    KnownHeight: lambda each: (
        "height",
        {"base": each.base, "top": each.top, "height_m": each.height_m, "std_m": each.std_m},
    ),
    Vertical: lambda each: ("vertical", {"pixels": each.pixels}),
    GroundLines: _lines,
    Horizon: lambda each: ("horizon", {"pixels": each.pixels, "sea": each.is_sea}),
}
