"""What pyproject.toml promises: every lowest version that it allows, and every Python, measures and passes tests."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.environments import (
    ROOT,
    RUN_EXTRAS,
    TEST_TOOLS,
    build_wheel,
    lowest_versions,
    make_environment,
    pinned_versions,
    python_of,
)

PARTS = ("tests/geometry", "tests/dft", "tests/calibration", "tests/reports", "tests/cli/test_maps.py")
PYTHONS = ("3.11", "3.12", "3.13")

pytestmark = [pytest.mark.nightly, pytest.mark.timeout(3600)]


def check(python: Path, tmp_path: Path) -> None:
    """Run the demo and the tests of some rooms from the working copy, with compiled loops in a folder of their own."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "PYTEST"))}
    clean |= {"NUMBA_CACHE_DIR": str(tmp_path / "compiled"), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    subprocess.run([python, "-m", "aerodft", "demo", "--output", tmp_path / "demo"], cwd=ROOT, env=clean, check=True)
    pytest_words = ["-m", "pytest", "-q", "-n", "2", "--dist", "loadfile", "--benchmark-disable", "-m", "not nightly"]
    subprocess.run([python, *pytest_words, *PARTS], cwd=ROOT, env=clean, check=True)


def tools() -> list[str]:
    pinned = pinned_versions()
    return [f"{name}=={pinned[name]}" for name in TEST_TOOLS]


def test_the_lowest_versions_are_enough(tmp_path: Path) -> None:
    wheel = build_wheel(tmp_path)
    check(make_environment(tmp_path / "env", sys.executable, wheel, *lowest_versions(), *tools()), tmp_path)


@pytest.mark.parametrize("version", PYTHONS)
def test_every_python_is_as_good(version: str, tmp_path: Path) -> None:
    python = python_of(version)
    if python is None or version == "{}.{}".format(*sys.version_info):
        pytest.skip(f"Python {version} is not here, or runs these tests")
    product = f"aerodft[{','.join(RUN_EXTRAS)}] @ {build_wheel(tmp_path).as_uri()}"
    constraints = ("--constraint", ROOT / "constraints.txt")
    check(make_environment(tmp_path / "env", python, *constraints, product, *tools()), tmp_path)
