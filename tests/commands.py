"""The command line in the test's own process: a process of its own takes a second before it does anything."""

import io
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from unittest.mock import patch

import orjson

from aerodft.cli.main import main


@dataclass(frozen=True)
class Run:
    """What a command did."""

    code: int
    out: bytes
    err: str

    @property
    def json(self):
        return orjson.loads(self.out)

    @property
    def last(self):
        """The last line on stderr: the sentence that says why."""
        return self.err.strip().splitlines()[-1]


def run_aerodft(*arguments: object) -> Run:
    """Run ``aerodft`` with these arguments in this process."""
    out, err = io.TextIOWrapper(io.BytesIO()), io.TextIOWrapper(io.BytesIO())
    code = 0
    with redirect_stdout(out), redirect_stderr(err), patch.object(sys, "argv", ["aerodft", *map(str, arguments)]):
        try:
            main()
        except SystemExit as ending:
            code = ending.code if isinstance(ending.code, int) else 1
    out.flush()
    err.flush()
    return Run(code, out.buffer.getvalue(), err.buffer.getvalue().decode())
