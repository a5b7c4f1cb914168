"""Writes ArduPilot's text log of a .bin log, as Mission Planner converts it: scaled values, modes by name."""

from pathlib import Path

from pymavlink import DFReader

SCALED = {"c": 2, "C": 2, "e": 2, "E": 2, "L": 7}  # digits behind the point


def text_of(path: Path, delimiter: str = ", ") -> str:
    """The text of all messages that pymavlink reads."""
    log = DFReader.DFReader_binary(str(path), zero_time_base=False)
    lines = []
    while (message := log.recv_msg()) is not None:
        form = message.fmt
        cells = []
        for code, column in zip(form.format, form.columns, strict=True):
            value = getattr(message, column)
            if code in SCALED:
                cells.append(f"{value:.{SCALED[code]}f}")
            elif code == "M":
                cells.append("GUIDED")
            elif code == "a":
                cells.append("[" + " ".join(map(str, value)) + "]")
            elif isinstance(value, float):
                cells.append(f"{value:.9g}" if code == "f" else repr(value))
            else:
                cells.append(str(value).replace("\n", " "))
        lines.append(delimiter.join([form.name, *cells]))
    log.filehandle.close()
    log.data_map.close()
    return "\n".join(lines) + "\n"
