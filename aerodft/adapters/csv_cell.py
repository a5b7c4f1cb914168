"""Texts from files as cells of a CSV table that a spreadsheet or a terminal may show."""

from aerodft.errors import printable

_FORMULAS = ("=", "+", "-", "@")
_MARK = "'"


def csv_cell(value: object) -> object:
    """A value that a spreadsheet takes for no formula, without control characters; numbers stay as they are."""
    if not isinstance(value, str):
        return value
    text = printable(value)
    return f"{_MARK}{text}" if text.startswith(_FORMULAS) else text


def cell_text(cell: str) -> str:
    """The text of a cell that ``csv_cell`` wrote."""
    return cell[1:] if cell.startswith(tuple(_MARK + each for each in _FORMULAS)) else cell
