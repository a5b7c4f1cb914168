"""Probes that people clicked, saved into the file of their station."""

from pathlib import Path

import numpy as np
import tomli_w

from aerodft.adapters.config.station import parse_station
from aerodft.adapters.files import whole_file
from aerodft.app.measure import ImageProbe
from aerodft.errors import InputError, UsageError


def add_probe(path: Path, probe: ImageProbe, *, at_ns: int | None) -> None:
    """Add a probe at the end of a station's file, which stays as it is otherwise.

    Args:
        path: The file.
        probe: What to measure.
        at_ns: Stamp (UTC) of the image that its pixels are of, from which they are followed over the ground; None where
            they are fixed in the image.

    Raises:
        UsageError: The probe has no name.
        InputError: The file cannot be read or written.
        ConfigError: It cannot take the probe: it has one of that name, or the name is none for a key.
    """
    if probe.name is None:
        raise UsageError("a probe of a station", got="no name", expected="a name of its own")
    pixels = np.asarray(probe.pixels, dtype=np.float64).tolist()
    table: dict[str, object] = {"name": probe.name, "kind": str(probe.kind), "pixels": pixels}
    if at_ns is not None:
        table |= {"tracked": True, "at": str(at_ns)}
    try:
        before = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError("the station's file cannot be read", where=path, got=error.strerror) from error
    after = f"{before.rstrip()}\n\n{tomli_w.dumps({'probe': [table]})}"
    parse_station(after.encode(), where=str(path), folder=path.parent)
    with whole_file(path, overwrite=True) as partial:
        partial.write_text(after, encoding="utf-8")
