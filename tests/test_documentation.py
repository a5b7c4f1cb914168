"""What the documentation says is true: its commands run, its output is theirs, its site knows every name."""

import contextlib
import html
import importlib.util
import io
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import tomllib
from itertools import takewhile
from pathlib import Path

import pytest
import typer

from aerodft.adapters.config.camera.calibration_file import CalibrationTable
from aerodft.adapters.config.camera.camera_file import CameraTable
from aerodft.adapters.config.evidence.evidence_file import FlightTable, ImageEntry
from aerodft.adapters.config.evidence.evidence_tables import EvidenceTable
from aerodft.adapters.config.evidence.markers import MarkersTable
from aerodft.adapters.config.station.station_tables import ConfigTable
from aerodft.adapters.outputs import OUTPUTS
from aerodft.adapters.wire.keys import Keys
from aerodft.cli.main import COMMANDS, build_app
from aerodft.dft import PROBE_KINDS
from aerodft.model import Status
from replay.export.table import COLUMNS
from tests.commands import run_aerodft

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$(?:\n+```text\n(.*?)^```$)?", re.MULTILINE | re.DOTALL)
SLOW = ("demo/", "aerodft.sim", "aerodft serve", "aerodft view", "sync", "dataset", "aerodft paper", "make ")
PATIENCE_S = 900.0
FILES = (ConfigTable, CameraTable, EvidenceTable, ImageEntry, FlightTable, MarkersTable, CalibrationTable)
PUNCTUATION = "`'\"()[]{}<>,.;:!?|=*"
IN_HERE = os.environ | {
    "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    "COLUMNS": "132",
    "NO_MKDOCS_2_WARNING": "1",
    "BROWSER": "true",
}


def blocks_of(page):
    return [match.groups() for match in BLOCK.finditer(page.read_text(encoding="utf-8"))]


def run(command, folder, code=0):
    done = subprocess.run(
        command, cwd=folder, env=IN_HERE, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert done.returncode == code, f"{command}\n{done.stdout[-1000:]}\n{done.stderr[-2000:]}"
    return done.stdout


def run_script(text, folder):
    """A block of which one line needs what another one leaves running, or set."""
    with tempfile.TemporaryFile() as said:
        with subprocess.Popen(
            ["bash", "-ec", text], cwd=folder, env=IN_HERE, stdout=said, stderr=said, start_new_session=True
        ) as shell:
            try:
                code = shell.wait(PATIENCE_S)
            finally:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(shell.pid, signal.SIGTERM)  # what runs in the background
        said.seek(0)
        assert code == 0, f"{text}\n{said.read()[-3000:].decode()}"


def run_until_ctrl_c(words, folder):
    with subprocess.Popen(
        [sys.executable, "-m", *words], cwd=folder, env=IN_HERE, stderr=subprocess.PIPE, text=True
    ) as process:
        said = list(takewhile(lambda line: "Ctrl-C" not in line, process.stderr))
        process.send_signal(signal.SIGINT)
        said.append(process.communicate(timeout=PATIENCE_S)[1])
    assert process.returncode == 0, f"{words}\n{said}"


def run_line(line, folder):
    code = int(found[1]) if (found := re.search(r"# exit (\d+)", line)) else 0
    program, *words = shlex.split(line, comments=True)
    if "view" in words or "--web" in words:
        return run_until_ctrl_c([program, *words], folder) or ""
    if program != "aerodft" or "serve" in words:
        return run(["bash", "-c", line], folder, code)
    with contextlib.chdir(folder):
        done = run_aerodft(*words)
    assert done.code == code, f"{line}\n{done.err[-2000:]}"
    return done.out.decode()


def run_block(language, text, output, folder):
    if language == "sh" and ("&\n" in text or ". .venv" in text):
        run_script(text, folder)
        return
    if language == "sh":
        said = "".join(run_line(line, folder) for line in text.replace("\\\n", " ").splitlines())
    elif language == "python":
        printed = io.StringIO()
        with contextlib.chdir(folder), contextlib.redirect_stdout(printed):
            exec(compile(text, "block", "exec"), {"__name__": "__main__"})  # noqa: S102 - a block of this repository
        said = printed.getvalue()
    elif language == "toml":
        tomllib.loads(text)
        return
    elif language == "json":
        json.loads(text)
        return
    if output is not None:
        assert said.strip() == output.strip()


@pytest.fixture
def folder(tmp_path):
    """A folder with what a clone has, to write in."""
    for name in ("configs", "samples", "docs", "tests"):
        (tmp_path / name).symlink_to(ROOT / name)
    return tmp_path


@pytest.fixture
def clone(tmp_path):
    run(["git", "clone", "--quiet", str(ROOT), str(tmp_path / "clone")], tmp_path)
    return tmp_path / "clone"


def with_blocks(is_slow):
    found = [page for page in PAGES if any(is_slow(text) for _, text, _ in blocks_of(page))]
    return pytest.mark.parametrize("page", found, ids=lambda page: str(page.relative_to(ROOT)))


@with_blocks(lambda text: not any(word in text for word in SLOW))
def test_blocks_run_and_say_what_is_shown(page, folder):
    for language, text, output in blocks_of(page):
        if not any(word in text for word in SLOW):
            run_block(language, text, output, folder)


@pytest.mark.nightly
@pytest.mark.timeout(3600)
@with_blocks(lambda text: any(word in text for word in SLOW))
def test_slow_blocks_run_too(page, folder, clone):
    if page.name == "README.md":
        folder = clone
    elif "demo/" in page.read_text(encoding="utf-8"):
        run([sys.executable, "-m", "aerodft", "demo", "--output", "demo", "--duration", "10"], folder)
    for language, text, output in blocks_of(page):
        run_block(language, text, output, folder)


def test_every_block_is_one_that_is_run_or_an_output():
    kinds = {language for page in PAGES for language, _, _ in blocks_of(page)}
    assert kinds == {"sh", "python", "toml", "json"}
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        pictures = len(re.findall(r"^```\n(?:.*\n)*?```$", text, re.MULTILINE)) if page.stem == "architecture" else 0
        fences = sum(2 + 2 * (output is not None) for _, _, output in blocks_of(page)) + 2 * pictures
        assert text.count("```") == fences, page


@pytest.mark.parametrize("name", COMMANDS)
def test_examples_of_the_help_have_only_options_that_there_are(name):
    command = typer.main.get_command(build_app([name])).commands[name]
    examples = re.findall(r"^ *(?:Example: )?aerodft (\S+)(.*)$", command.help.replace("\\\n", " "), re.MULTILINE)
    assert examples
    for asked, words in examples:
        assert asked == name
        command.make_context(name, shlex.split(words))


def test_every_helper_of_the_tests_stands_on_their_page():
    folder = ROOT / "tests"
    named = set(re.findall(r"`([\w/]+\.py)`", (folder / "README.md").read_text()))
    modules = {each.relative_to(folder).as_posix() for each in folder.rglob("*.py")}
    helpers = {each for each in modules if not Path(each).name.startswith(("test_", "bench_", "conftest", "__init__"))}
    assert named - {"service/conftest.py"} == helpers


def test_the_readme_is_read_in_five_minutes():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The built site: warnings, broken links and names that are not there are errors."""
    if importlib.util.find_spec("mkdocs") is None:
        pytest.skip('the extra "docs" is not installed')
    out = tmp_path_factory.mktemp("site")
    run([sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(out)], ROOT)
    return out


@pytest.mark.parametrize("name", [path.stem for path in sorted((ROOT / "docs/notebooks").glob("*.py"))])
def test_a_notebook_is_run_and_shown_with_its_pictures(site, name):
    page = (site / f"notebooks/{name}.html").read_text(encoding="utf-8")
    notebook = json.loads((site / f"notebooks/{name}.ipynb").read_text(encoding="utf-8"))
    outputs = [each for cell in notebook["cells"] for each in cell.get("outputs", ())]
    pictures = sorted((site / "notebooks").glob(f"{name}-*.png"))
    assert len(pictures) == sum("image/png" in each.get("data", ()) for each in outputs) >= 2
    assert all(picture.name in page for picture in pictures)
    assert any(each.get("name") == "stdout" for each in outputs)
    assert "False" not in "".join(each.get("text", "") for each in outputs)  # of each truth: whether it is inside


def test_pages_load_nothing_from_the_network(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 50
    loaded = re.compile(r"<(?:script|img|iframe)[^>]*src=\"https?:|<link[^>]*rel=\"(?:stylesheet|preload)[^>]*https?:")
    assert [page.name for page in pages if loaded.search(page.read_text(encoding="utf-8"))] == []


def words_of(text, separator):
    """What the site's search takes a text for: words without what is around them."""
    plain = html.unescape(re.sub(r"<[^>]+>", " ", text)).lower()
    return {word.strip(PUNCTUATION) for word in re.split(separator, plain)} - {""}


def options():
    """Every option of every command that its help shows."""
    for name in COMMANDS:
        command = typer.main.get_command(build_app([name])).commands[name]
        yield from (option for each in command.params if not getattr(each, "hidden", False) for option in each.opts)


def keys(model):
    """Every key of a file, and of the tables within."""
    schema = model.model_json_schema()
    for table in (schema, *schema.get("$defs", {}).values()):
        yield from table.get("properties", {})


def test_the_search_finds_every_option_key_status_and_topic(site):
    index = json.loads((site / "search/search_index.json").read_text(encoding="utf-8"))
    separator = index["config"]["separator"]
    assert "stopWordFilter" not in index["config"]["pipeline"]  # --at, --from and --to are options
    sections = [words_of(f"{entry['title']} {entry['text']}", separator) for entry in index["docs"]]
    names = {*map(str, Status), *COLUMNS, *PROBE_KINDS, *(f"aerodft {name}" for name in COMMANDS)}
    topics = Keys("{station}")
    names |= set(vars(topics).values()) - {"aerodft/{station}"} | {
        topics.measurement("{probe}"),
        topics.number("{probe}"),
    }
    names |= {name for name in options() if name.startswith("--")}
    names |= {name for model in (*FILES, *(kind.MODEL for kind in OUTPUTS)) for name in keys(model)}
    assert len(names) > 350
    assert [name for name in sorted(names) if not any(words_of(name, separator) <= words for words in sections)] == []
