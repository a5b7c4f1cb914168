"""The registry of outputs, their tables in a station's configuration, and what opens them for a run.

A new output is a module that has what ``OutputKind`` says, and one line here. The recording is none of them: every run
has one.
"""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Any, Final

from aerodft.adapters.config import Table, validated
from aerodft.adapters.outputs import foxglove, zenoh_bus
from aerodft.adapters.outputs.output import Output, OutputKind, Run

OUTPUTS: Final[list[OutputKind]] = [
    zenoh_bus,
    foxglove,
]


def default_outputs() -> dict[str, Table]:
    """The outputs of a station whose configuration says nothing of them, by their tables."""
    return {kind.TABLE: kind.DEFAULT for kind in OUTPUTS if kind.DEFAULT is not None}


def outputs_from(document: dict[str, Any]) -> dict[str, Table]:
    """Take the tables of outputs out of a configuration.

    Args:
        document: The configuration as TOML keys; loses these tables.

    Returns:
        The settings of each output, by its table.

    Raises:
        ConfigError: Unknown key, or impossible value.
    """
    stated = {
        kind.TABLE: validated(kind.MODEL, document.pop(kind.TABLE), f"{kind.TABLE}.")
        for kind in OUTPUTS
        if kind.TABLE in document
    }
    return default_outputs() | stated


def outputs_document(outputs: Mapping[str, Table]) -> dict[str, Any]:
    """The tables of outputs as TOML keys."""
    return {name: table.model_dump(mode="json", exclude_none=True) for name, table in outputs.items()}


@contextmanager
def open_outputs(outputs: Mapping[str, Table], run: Run) -> Iterator[tuple[Output, ...]]:
    """The outputs of a run, which are closed at the end.

    Args:
        outputs: Settings by table.
        run: Whose outputs they are.

    Raises:
        AerodftError: One cannot be opened.
    """
    with ExitStack() as stack:
        found = []
        for kind in OUTPUTS:
            settings = outputs.get(kind.TABLE)
            output = None if settings is None else kind.open_output(settings, run)
            if output is not None:
                stack.callback(output.close)
                found.append(output)
        yield tuple(found)
