"""Every option, command and configuration key that a sentence of the code names exists."""

import ast
import re
from pathlib import Path
from types import UnionType
from typing import Union, get_args, get_origin

import pytest
import typer
from pydantic import BaseModel

import aerodft
import calibration
import replay
from aerodft.adapters.config.camera.calibration_file import CalibrationTable
from aerodft.adapters.config.camera.camera_file import CameraTable
from aerodft.adapters.config.evidence.evidence_file import ImagesEvidenceTable
from aerodft.adapters.config.evidence.evidence_tables import EvidenceTable
from aerodft.adapters.config.evidence.markers import MarkersTable
from aerodft.adapters.config.station.station_tables import ConfigTable
from aerodft.adapters.outputs.registry import OUTPUTS
from aerodft.cli.main import COMMANDS, build_app
from aerodft.cli.options import as_typed
from aerodft.sim.__main__ import app as simulator

ROOTS = [Path(package.__file__).parent for package in (aerodft, calibration, replay)]
TABLES = (ConfigTable, ImagesEvidenceTable, EvidenceTable, MarkersTable, CalibrationTable, CameraTable)
OUTPUT_TABLES = {kind.TABLE: kind for kind in OUTPUTS}
FILES = {
    "bin",
    "csv",
    "geojson",
    "html",
    "jpg",
    "json",
    "jsonl",
    "md",
    "mp4",
    "npz",
    "png",
    "tif",
    "tlog",
    "toml",
    "txt",
}
OF_IMPORT = (
    "app/importing.py",
    "app/align.py",
    "adapters/images/video.py",
    "adapters/images/stills.py",
    "sync/alignment.py",
)
"""Modules whose sentences `import` says, and what they name must be an option of `import`, or a command."""


def sentences(path):
    """The strings of a module that are no docstrings; of an f-string the constant parts, with a gap between."""
    tree = ast.parse(path.read_text())
    ignored = set()
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            ignored |= {id(each.value) for each in body if isinstance(each, ast.Expr)}
        if isinstance(node, ast.JoinedStr):
            ignored |= {id(each) for each in node.values}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in ignored:
            yield node.value
        elif isinstance(node, ast.JoinedStr):
            yield "".join(each.value if isinstance(each, ast.Constant) else "\0" for each in node.values)


SAID = [(path, text) for root in ROOTS for path in sorted(root.rglob("*.py")) for text in sentences(path)]


def options_of(command):
    return {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)} | {"--help"}


@pytest.fixture(scope="module")
def options():
    """The options of each command, and of the simulator."""
    found = {name: options_of(typer.main.get_command(build_app([name])).commands[name]) for name in COMMANDS}
    found["sim"] = options_of(typer.main.get_command(simulator))
    found["yard"] = {"--flown"}  # an argparse of its own
    found[""] = options_of(typer.main.get_command(build_app([])))
    return found


def test_every_option_exists(options):
    known = set().union(*options.values())
    named = {(path.name, name) for path, text in SAID for name in re.findall(r"(?<![\w-])--[a-z][a-z-]*[a-z]", text)}
    assert {name for _, name in named} > {"--home-above-plane", "--max-offset", "--set"}, "sentences are found"
    assert sorted(each for each in named if each[1] not in known) == []


OF_PYTHON = {"load_camera", "on_top_of", "pixels", "points_m"}
"""Names that sentences of ``aerodft.app.measure`` say to callers of functions alone: --probe states these."""


def test_every_name_in_backticks_is_typed_as_something_that_exists(options):
    known = set().union(*options.values())
    wrong = []
    for path, text in SAID:
        if path.parent.name == "wire":  # schemas name fields of documents
            continue
        for name in set(re.findall(r"`([a-z_]+)`", text)) - (OF_PYTHON if path.parent.name == "measure" else set()):
            typed = as_typed(f"`{name}`")
            is_command = typed.startswith("`aerodft ") and typed.strip("`").split()[1] in COMMANDS
            if not is_command and typed.split()[0] not in known:
                wrong.append((path.name, name, typed))
    assert sorted(set(wrong)) == []


def test_every_command_exists():
    named = {(path.name, name) for path, text in SAID for name in re.findall(r"`aerodft ([a-z-]+)", text)}
    assert len(named) > 5
    assert sorted(each for each in named if each[1] not in COMMANDS) == []


def test_what_import_says_is_an_option_of_import(options):
    """`max_offset_s` is said where `sync` runs inside `import`; an option of `sync` alone would lead nowhere."""
    wrong, seen = [], set()
    for path, text in SAID:
        if path.as_posix().endswith(OF_IMPORT):
            for name in re.findall(r"`([a-z_]+)`", text):
                typed = as_typed(f"`{name}`").split()[0]
                seen.add(typed)
                is_of_photo = name == "camera"  # a photo's own camera is read by commands that take one
                if typed.startswith("--") and typed not in options["import"] and not is_of_photo:
                    wrong.append((path.name, name, typed))
    assert seen >= {"--max-offset", "--utc-offset", "--video-start"}
    assert wrong == []


def nested(annotation):
    """All tables that an annotation holds."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return {annotation}
    parts = get_args(annotation) if get_origin(annotation) in (Union, UnionType, tuple, list, dict) else ()
    parts = parts or get_args(annotation)
    return set().union(*(nested(each) for each in parts)) if parts else set()


def exists(path, tables):
    """Whether a dotted key is one of any of the tables."""
    first, _, rest = path.partition(".")
    for table in tables:
        for name, field in table.model_fields.items():
            if first not in (name, field.alias):
                continue
            below = nested(field.annotation)
            if not rest or exists(rest, below) or any(each.model_config.get("extra") == "allow" for each in below):
                return True
    return False


def output_key_exists(path):
    table, _, key = path.partition(".")
    kind = OUTPUT_TABLES.get(table)
    return kind is not None and (not key or exists(key, [kind.MODEL]))


FIRST = {name for table in TABLES for name in table.model_fields} | OUTPUT_TABLES.keys()


def test_every_configuration_key_exists():
    wrong, seen = [], set()
    for path, text in SAID:
        for key in re.findall(r"(?<![\w./-])([a-z_]+(?:\.[a-z_]+)+)(?![\w/(\0-])", text):
            if key.partition(".")[0] in FIRST and key.rpartition(".")[2] not in FILES:
                seen.add(key)
                if not exists(key, TABLES) and not output_key_exists(key):
                    wrong.append((path.name, key))
    assert seen > {"images.time_offset_s", "telemetry.height.home_above_plane_m", "images.utc_offset"}
    assert sorted(set(wrong)) == []


def test_every_table_exists():
    wrong, seen = [], set()
    for path, text in SAID:
        if path.name == "layouts.py":  # columns of other tools' tables, with their units in brackets
            continue
        for name in re.findall(r"(?:^|(?<= ))\[([a-z_]+(?:\.[a-z_]+)*)\](?=[ ,;:]|$)", text):
            seen.add(name)
            is_column = " " not in text or "\\" in text  # of another format, or a pattern
            if not is_column and not exists(name, TABLES) and not output_key_exists(name):
                wrong.append((path.name, name))
    assert seen > {"telemetry", "pose", "images"}
    assert sorted(set(wrong)) == []
