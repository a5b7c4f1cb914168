"""Pages that the code itself tells: commands, configuration keys, statuses, sentences, schemas, keys on the bus."""

import ast
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_args

import orjson
import typer

from aerodft import errors
from aerodft.adapters.config.camera.calibration_file import CalibrationTable
from aerodft.adapters.config.camera.camera_file import CameraTable
from aerodft.adapters.config.evidence.evidence_file import FlightTable, ImageEntry
from aerodft.adapters.config.evidence.evidence_tables import EvidenceTable
from aerodft.adapters.config.evidence.markers import MarkersTable
from aerodft.adapters.config.station.station_tables import ConfigTable
from aerodft.adapters.config.tables import Table, Uncertain
from aerodft.adapters.outputs import OUTPUTS
from aerodft.cli import main
from aerodft.cli.options import help_record

ROOT = Path(__file__).parents[2]
PACKAGES = ("aerodft", "calibration", "replay")
UNITS = {
    "m": "m",
    "px": "px",
    "deg": "deg",
    "s": "s",
    "ms": "ms",
    "hz": "Hz",
    "mb": "MB",
    "mm": "mm",
    "dps": "deg/s",
    "percent": "%",
    "mps": "m/s",
    "mps2": "m/s²",
}
FILES = {
    "Station file": ("services", ((ConfigTable, ""), *((kind.MODEL, f"{kind.TABLE}.") for kind in OUTPUTS))),
    "Camera file": ("cameras", ((CameraTable, ""),)),
    "Evidence for a calibration": ("calibration", ((EvidenceTable, ""),)),
    "Evidence in images of a flight": ("calibration", ((ImageEntry, "image."), (FlightTable, "telemetry."))),
    "Markers": ("calibration", ((MarkersTable, ""),)),
    "Calibration file": ("sites", ((CalibrationTable, ""),)),
}
"""Kinds of file: the folder of examples whose comments explain the keys; the tables, and what stands before them."""

_BEGINS = re.compile(r"^(?:# ?)?\[\[?([a-z_.]+)\]\]?")
_ASSIGNS = re.compile(r"^(?:# ?)?([a-z][a-z0-9_]*) = (.*)$")
_CONTINUES = re.compile(r"^#?\s{12,}#?\s*(.*)$")
_NOTED = re.compile(r'^ +(?:self\.)?\w+ = f?"(.+?)"  # (.*)$')
_CLASSES = {
    name: kind
    for name, kind in vars(errors).items()
    if isinstance(kind, type) and issubclass(kind, errors.AerodftError)
}
_SHORT = 3  # letters of a sentence that only what is found at run time fills
_EXIT_CODES = {
    0: "Done.",
    1: "A bug: the traceback says where. Please report it.",
    2: "The command line makes no sense; nothing was done.",
    3: "An input or a configuration is missing, damaged or impossible.",
    4: "The input is sound, but holds no answer to what was asked.",
    5: "Done, with a difference (`compare`) or a loss (of what could not be read or written).",
    130: "Ended by Ctrl-C before its work was done; `serve`, `replay` and an open page (`view`) end with 0 or 4.",
    141: "Whoever read stdout has closed it.",
    143: "Ended by SIGTERM, as by Ctrl-C. A second signal, 0.3 s later or more, ends every command at once.",
}


def pages() -> dict[str, str]:
    """All of them, by their path in the site."""
    makers: dict[str, Callable[[], str]] = {
        "reference/commands.md": commands,
        "reference/configuration.md": configuration,
        "reference/examples.md": examples,
        "reference/schemas.md": schemas,
        "reference/bus.md": bus,
        "reference/statuses.md": statuses,
        "reference/exit-codes.md": exit_codes,
        "troubleshooting/sentences.md": sentences,
        "decisions/index.md": decisions,
    }
    return {path: make() for path, make in makers.items()}


def commands() -> str:
    """Every command with every option, as typer has them."""
    parts = [
        "# Commands\n\nEvery command has `--help`. Paths are files of yours unless an example below names one here.\n"
    ]
    for name in main.COMMANDS:
        command = typer.main.get_command(main.build_app([name])).commands[name]
        text, _, example = (command.help or "").partition("\b\n")
        lines = [
            line.removeprefix("  ") for line in example.splitlines() if line.strip() not in {"Example:", "Examples:"}
        ]
        parts += [f"## aerodft {name}\n", _flowed(text)]
        if lines:
            parts.append("\n```text\n" + "\n".join(lines).strip("\n") + "\n```\n")
        parts.append("| option | what | default |\n| --- | --- | --- |")
        context = command.make_context(name, [], resilient_parsing=True)
        for each in command.params:
            if record := help_record(each, context):
                what = re.sub(r"\s*\[(default|required)[^\]]*\]\s*$", "", record[1])
                parts.append(f"| `{_code(record[0])}` | {_cell(_flowed(what))} | {_default(each)} |")
        parts.append("")
    return "\n".join(parts)


def _default(option: Any) -> str:
    if option.required:
        return "required"
    plain = option.default is not None and not callable(option.default) and option.default not in (False, (), [])
    return f"`{_code(str(option.default))}`" if plain else ""


def configuration() -> str:
    """Every key of every file, with its unit, range and default, and the reason that the example files give."""
    head = (
        "# Configuration keys\n\nA key's unit is the end of its name. What is left out takes the default;"
        " an unknown key is an error. The [example files](examples.md) have the keys in place.\n"
    )
    parts = [head]
    for title, (folder, tables) in FILES.items():
        texts = explained(ROOT / "configs" / folder)
        parts.append(f"## {title}\n")
        for table, prefix in tables:
            rows: dict[str, list[str]] = {}
            for path, row in _rows(table, prefix, texts, ""):
                rows.setdefault(path.rpartition(".")[0], []).append(row)
            for name, lines in rows.items():
                parts += [f"### {title}: [{name}]\n" if name else "", "| key | what | unit | value | default |"]
                parts += ["| --- | --- | --- | --- | --- |", *lines, ""]
    return "\n".join(parts)


def explained(folder: Path) -> dict[str, str]:
    """What the comments of a folder's example files say of each key, by ``table.key``; of tables by their name."""
    found: dict[str, str] = {}
    for path in sorted(folder.glob("*.toml")):
        table, key = "", ""
        for line in path.read_text(encoding="utf-8").splitlines():
            if begins := _BEGINS.match(line):
                table = key = begins[1]
            elif assigns := _ASSIGNS.match(line):
                key, line = f"{table}.{assigns[1]}".lstrip("."), assigns[2]  # noqa: PLW2901 - what is left of it
            elif more := _CONTINUES.match(line):
                if key:
                    found[key] = f"{found.get(key, '')} {more[1]}".strip()
                continue
            else:
                key = ""
                continue
            comment = re.split(r"\s+#\s+", line, maxsplit=1)[1:]
            if comment and not found.get(key):
                found[key] = comment[0]
    return found


def _rows(table: type[Table], prefix: str, texts: dict[str, str], above: str) -> Iterator[tuple[str, str]]:
    """Every key of a table and of those within it: its path, and its row."""
    schema = table.model_json_schema()
    definitions = schema.get("$defs", {})
    about = above or _first(table.__doc__)
    for name, field in table.model_fields.items():
        name = field.alias or name  # noqa: PLW2901 - as it is written
        path, shape = f"{prefix}{name}", schema["properties"][name]
        nested = next((each for each in _classes(field.annotation) if issubclass(each, Table)), None)
        if nested is not None and issubclass(nested, Uncertain):
            nested = None
        text = texts.get(path) or (_first(nested.__doc__) if nested else about)
        value = "table" if nested else _value(shape, definitions)
        unit = next((UNITS[part] for part in reversed(name.split("_")) if part in UNITS), "")
        default = "required" if field.is_required() else "" if nested else _shown(shape.get("default"))
        yield path, f"| `{name}` | {_cell(text)} | {unit} | {_cell(value)} | {_code(default)} |"
        if nested is not None:
            yield from _rows(nested, f"{path}.", texts, texts.get(path, ""))


def _classes(annotation: object) -> Iterator[type]:
    if isinstance(annotation, type) and not get_args(annotation):
        yield annotation
    for each in get_args(annotation):
        yield from _classes(each)


def _value(shape: dict[str, Any], definitions: dict[str, Any]) -> str:
    """What a key may hold, in words."""
    shape = definitions[shape["$ref"].rpartition("/")[2]] if "$ref" in shape else shape
    if "anyOf" in shape:
        return " or ".join(
            dict.fromkeys(_value(each, definitions) for each in shape["anyOf"] if each.get("type") != "null")
        )
    if "enum" in shape:
        return ", ".join(f'"{each}"' for each in shape["enum"])
    kind = shape.get("type", "any")
    if kind == "array":
        items = shape.get("items") or (shape.get("prefixItems") or [{}])[0]
        return f"list of {_value(items, definitions)}" if items else "list"
    if kind == "object":
        return "number, or { value, std }" if "std" in shape.get("properties", {}) else "table"
    bounds = [f"{word} {shape[key]:g}" for key, word in _BOUNDS.items() if abs(shape.get(key, 1e12)) < 1e9]  # noqa: PLR2004
    return " ".join(
        [{"string": "text", "boolean": "true or false", "integer": "whole number"}.get(kind, kind), *bounds]
    )


_BOUNDS = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}


def _shown(default: object) -> str:
    if isinstance(default, dict):
        default = default.get("value")
    return "" if default in (None, [], "") else f"`{orjson.dumps(default).decode()}`"


def examples() -> str:
    """The example files as they are."""
    parts = ["# Example files\n"]
    for path in sorted((ROOT / "configs").glob("*/*.toml")):
        if path.parent.name != "cameras" or "demo" in path.name:
            name = path.relative_to(ROOT)
            parts.append(f"## {name} {{ #{_slug(path)} }}\n\n```toml\n{path.read_text(encoding='utf-8')}```\n")
    return "\n".join(parts)


def _slug(path: Path) -> str:
    return f"{path.parent.name}-{path.stem}"


def schemas() -> str:
    """The JSON Schemas of all payloads."""
    parts = [
        "# JSON Schemas\n\nDraft 2020-12. 64-bit stamps are decimal strings; what is not known is null, never absent.\n"
    ]
    for path in sorted((ROOT / "docs/schema").glob("*.json")):
        text = orjson.dumps(orjson.loads(path.read_bytes()), option=orjson.OPT_INDENT_2).decode()
        parts.append(f"## {path.stem}\n\n```json\n{text}\n```\n")
    return "\n".join(parts)


def bus() -> str:
    """Topics and queries of a station on the bus."""
    texts = _commented("aerodft/adapters/wire/keys.py")
    texts["{self.root}/measurement/{probe}"] = "every measurement, in images and on demand"
    texts["{self.root}/number/{probe}"] = "in an exported file, in Foxglove: a probe's values alone, for plots"
    rows = [f"| `{key.replace('{self.root}', 'aerodft/{station}')}` | {_cell(text)} |" for key, text in texts.items()]
    head = (
        "# Topics and queries\n\nOn zenoh, by default at `tcp/127.0.0.1:7447` without multicast; a recording's"
        " topics have the same names. Payloads are JSON ([schemas](schemas.md)) unless it says otherwise.\n\n"
        "A query without an answer gets a zenoh *error reply*, in Python `reply.err` instead of `reply.ok`: its payload"
        " (`aerodft.error/1`) has the [exit code](exit-codes.md) that a command would end with, and the sentence, as in"
        ' `{"code": 3, "sentence": "measure: kind: got ..."}`. What is asked rightly and cannot be measured'
        " is answered with a [status](statuses.md). `replay` answers as the station did at the time that is being"
        " replayed: from the inputs recorded until then, `history` with what this round has published.\n"
    )
    return "\n".join([head, "| key | what |", "| --- | --- |", *rows, ""])


def statuses() -> str:
    """Every status with its cause and its cure."""
    texts = _commented("aerodft/model/status.py")
    rows = [
        f"| `{name}` | " + " | ".join(_cell(part) for part in text.split(" Cure: ")) + " |"
        for name, text in texts.items()
    ]
    head = "# Statuses\n\nEverything but `ok` comes without a value; `reasons` says in sentences what was found.\n"
    return "\n".join([head, "| status | cause | cure |", "| --- | --- | --- |", *rows, ""])


def _commented(path: str) -> dict[str, str]:
    """The texts that a module assigns, each with the comment beside and below it."""
    found: dict[str, str] = {}
    last = ""
    for line in (ROOT / path).read_text(encoding="utf-8").splitlines():
        if match := _NOTED.match(line):
            last = match[1]
            found[last] = match[2]
        elif last and line.strip().startswith("# "):
            found[last] = f"{found[last]} {line.strip(' #')}"
        else:
            last = ""
    return found


def exit_codes() -> str:
    """What a command's exit code says."""
    rows = []
    for code, text in _EXIT_CODES.items():
        raised = ", ".join(f"`{name}`" for name, kind in _CLASSES.items() if kind.exit_code == code)
        rows.append(f"| {code} | {text} | {raised} |")
    head = (
        "# Exit codes\n\n`measure` ends with 3 if any pixel lies outside the image, with 4 if no probe has an answer,"
        " else with 0: each measurement has its own status.\n"
    )
    return "\n".join([head, "| code | what | raised in Python |", "| --- | --- | --- |", *rows, ""])


def sentences() -> str:
    """Every sentence of an error in the code, with what was expected and what to do, by exit code."""
    found: dict[int, set[tuple[str, str, str]]] = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            for kind, row in _raised(ast.parse(path.read_text(encoding="utf-8"))):
                found.setdefault(_CLASSES[kind].exit_code, set()).add(row)
    head = (
        "# By the sentence\n\nWhat is printed begins with the file, key or time that it is about. `…` stands for what"
        " was found there: search for a word beside it. What the Python API calls `max_range_m` is `--max-range`.\n"
    )
    parts = [head]
    for code, rows in sorted(found.items()):
        parts.append(
            f"## Exit code {code}: {_EXIT_CODES[code]}\n\n| sentence | expected | what to do |\n| --- | --- | --- |"
        )
        parts += [
            f"| {' | '.join(map(_cell, row))} |" for row in sorted(rows, key=lambda row: row[0].lower().strip("…` "))
        ]
        parts.append("")
    return "\n".join(parts)


def _raised(module: ast.Module) -> Iterator[tuple[str, tuple[str, str, str]]]:
    constants = _assigned(module.body)
    for function in (node for node in ast.walk(module) if isinstance(node, ast.FunctionDef)):
        names = constants | _assigned(list(ast.walk(function)))
        for call in ast.walk(function):
            if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Name)):
                continue
            kind = "ConfigError" if call.func.id == "impossible" else call.func.id
            if kind not in _CLASSES or not call.args:
                continue
            stated = {each.arg: _sentence(each.value, names) for each in call.keywords}
            what = _sentence(call.args[0], names)
            if call.func.id == "impossible":
                what = f"{what or '…'}: got {stated.get('got', '…')}"
            if len(what.replace("…", "").strip()) > _SHORT:
                yield kind, (what, stated.get("expected", ""), stated.get("hint", ""))


def _assigned(nodes: list[Any]) -> dict[str, ast.expr]:
    """Expressions by the names that they are assigned to."""
    return {
        target.id: node.value
        for node in nodes
        if isinstance(node, ast.Assign)
        for each in node.targets
        for target, node in (
            zip(each.elts, (ast.Assign([], value) for value in node.value.elts), strict=False)
            if isinstance(each, ast.Tuple) and isinstance(node.value, ast.Tuple)
            else [(each, node)]
        )
        if isinstance(target, ast.Name)
    }


def _sentence(node: ast.expr, names: dict[str, ast.expr], hole: str = "…") -> str:
    """The text of an expression, with holes for what is known at run time only."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else ""
    if isinstance(node, ast.JoinedStr):
        return "".join(_sentence(each, names, hole) for each in node.values)
    if isinstance(node, ast.Name) and node.id in names:
        return _sentence(names[node.id], {}, hole)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _sentence(node.left, names, hole) + _sentence(node.right, names, hole)
    if isinstance(node, ast.FormattedValue):
        return hole.format(ast.unparse(node.value))
    return hole.format("")


def decisions() -> str:
    """The list of decisions."""
    rows = []
    for path in sorted((ROOT / "docs/decisions").glob("0*.md")):
        title = path.read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")
        rows.append(f"- [{title}]({path.name})")
    return "# Decisions\n\nWhat a newcomer might undo, ten lines each.\n\n" + "\n".join(rows) + "\n"


def _first(docstring: str | None) -> str:
    return " ".join((docstring or "").split("\n\n", maxsplit=1)[0].split())


def _flowed(text: str) -> str:
    """Paragraphs of a help text as Markdown."""
    return "\n\n".join(" ".join(part.split()) for part in text.split("\n\n")).strip() + "\n"


def _code(text: str) -> str:
    return text.strip().replace("\n", " ").replace("|", "\\|")


def _cell(text: str) -> str:
    return _code(text).replace("<", "&lt;").replace("[", "\\[")
