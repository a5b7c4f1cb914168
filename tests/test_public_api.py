"""The public names: each can be loaded, stands where it is said to be, and its example gives what it shows."""

import doctest
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import aerodft

ROOT = Path(__file__).parents[1]
NAMES = [name for name in aerodft.__all__ if name != "__version__"]
FUNCTIONS = [name for name in NAMES if inspect.isfunction(getattr(aerodft, name))]


def test_importing_aerodft_loads_none_of_its_rooms():
    seen = "import sys, aerodft; print(sorted({'numpy', 'aerodft.app', 'aerodft.model'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", seen], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_a_name_that_is_not_there_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'mesure'"):
        _ = aerodft.mesure


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_function_has_an_example(name):
    assert ">>> " in (inspect.getdoc(getattr(aerodft, name)) or "")


@pytest.mark.parametrize("name", NAMES)
def test_examples_give_what_they_show(name, tmp_path, monkeypatch):
    for folder in ("configs", "samples", "tests"):  # what examples read; what they write goes beside
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    examples = doctest.DocTestFinder().find(getattr(aerodft, name), name)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    said: list[str] = []
    for each in examples:
        runner.run(each, out=said.append)
    assert runner.summarize(verbose=False).failed == 0, "".join(said)
