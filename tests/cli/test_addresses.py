"""The address of a store is no folder of this machine: nothing is written to a folder that is called ``s3:``."""

import pytest

from tests.commands import run_aerodft

RECORDING = "tests/cli/frozen-0.1"
COMMANDS = {
    "recompute": (RECORDING, "-o", "s3://bucket/x"),
    "export": (RECORDING, "-o", "gs://bucket/x.csv"),
    "frames": (RECORDING, "--every", "1", "-o", "s3://bucket/x"),
    "init": ("samples/copter.tlog", "-o", "az://bucket/x"),
    "demo": ("--output", "s3://bucket/x"),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_nothing_is_written_to_an_address(name):
    run = run_aerodft(name, *COMMANDS[name])
    scheme = next(word for word in COMMANDS[name] if "://" in word).split("//")[0]
    assert run.code == 3
    assert f"nothing can be written to an address: got {scheme}, expected a folder or file on this" in run.err
