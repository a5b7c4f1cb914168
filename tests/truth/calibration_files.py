"""The real ``aerodft calibrate`` on files that a test writes."""

from dataclasses import dataclass
from pathlib import Path

import tomli_w

from aerodft.model import GroundLines, GroundPoint, Horizon, KnownHeight, KnownLength, Landmark, SlantRange, Vertical
from tests.commands import run_aerodft


@dataclass(frozen=True, slots=True)
class Answer:
    """What a command said: its exit code, its JSON document (None where it printed none) and its last words."""

    code: int
    document: dict | None
    words: str

    def value(self, name):
        assert self.document is not None
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
    """Run a command with ``--json``."""
    done = run_aerodft(*arguments, "--json")
    return Answer(done.code, done.json if done.out else None, done.err.strip())


def tables(evidence) -> dict:
    """Observations as a file of evidence has them; of each kind a list."""
    found: dict[str, list] = {}
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
