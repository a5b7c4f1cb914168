"""Environments of their own: the wheel, the Pythons that are here, and versions as pyproject.toml bounds them."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
RUN_EXTRAS = ("terrain", "pandas", "parquet", "geo", "batch", "web", "foxglove")
"""Extras that users take; the others are for who works on aerodft."""
TEST_TOOLS = (
    "hypothesis",
    "jsonschema",
    "playwright",
    "pytest",
    "pytest-benchmark",
    "pytest-timeout",
    "pytest-xdist",
)
_BOUND = re.compile(r"([\w.-]+)(\[\w+\])?>=([\w.]+)")


def lowest_versions() -> list[str]:
    """Requirements that pin everything that users install to the lowest version that pyproject.toml allows."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    stated = [
        *project["dependencies"],
        *(each for name in RUN_EXTRAS for each in project["optional-dependencies"][name]),
    ]
    bounds = [_BOUND.fullmatch(each) for each in stated]
    assert all(bounds), "a requirement of pyproject.toml is NAME>=VERSION"
    return sorted({f"{bound[1]}{bound[2] or ''}=={bound[3]}" for bound in bounds if bound})


def pinned_versions() -> dict[str, str]:
    """Versions of constraints.txt by name."""
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").split()
    return dict(line.split("==") for line in lines)


def python_of(version: str) -> Path | None:
    """A Python ``3.12`` of this machine: of the system, of pyenv or of uv; None where there is none."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    candidates: list[str | Path | None] = [shutil.which(f"python{version}")]
    candidates += sorted(pyenv.glob(f"versions/{version}.*/bin/python"))
    if uv := shutil.which("uv"):
        found = subprocess.run([uv, "python", "find", version], capture_output=True, text=True, check=False)
        candidates.append(found.stdout.strip())
    asked = "import sys; print('{}.{}'.format(*sys.version_info))"
    for each in candidates:  # a shim of pyenv may stand for nothing
        if not each:
            continue
        said = subprocess.run([each, "-c", asked], capture_output=True, text=True, check=False)
        if said.stdout.strip() == version:
            return Path(each)
    return None


def make_environment(folder: Path, python: Path | str, *requirements: str | Path) -> Path:
    """Install requirements into a new environment, by uv where it is there, else by pip; returns its Python."""
    own = folder / "bin/python"
    install: list[str | Path] = [own, "-m", "pip", "--disable-pip-version-check", "-q", "install"]
    if uv := shutil.which("uv"):
        subprocess.run([uv, "venv", "--quiet", "--python", python, folder], check=True)
        install = [uv, "pip", "install", "--quiet", "--python", own]
    else:
        subprocess.run([python, "-m", "venv", folder], check=True)
    subprocess.run([*install, *requirements], check=True)
    return own


def build_wheel(folder: Path) -> Path:
    """Build the wheel of what Git tracks, in a copy: a folder ``build`` of before would be packed with it."""
    copy = folder / "source"
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True).stdout
    for name in tracked.decode().split("\0"):
        if name and (ROOT / name).is_file():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, copy / name)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q"]
    subprocess.run([*pip, "wheel", "--no-deps", "-w", folder, copy], check=True)
    (wheel,) = folder.glob("aerodft-*.whl")
    return wheel
