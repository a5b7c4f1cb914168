"""The real ``aerodft calibrate`` on files that a test writes."""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import tomli_w


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
