"""Measurements as Parquet: typed columns, 64-bit stamps, lists for points; needs the extra ``parquet``."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self, TypeAlias

from aerodft.errors import InputError
from replay.export.table import COLUMNS, ColumnType, Item, row_of

_ROWS_AT_ONCE: Final = 16_384

ArrowObject: TypeAlias = Any
"""Of pyarrow, an extra without types."""


class ParquetRows:
    """A Parquet file of measurements, written in groups of rows; whole only after a ``with`` that did not raise.

    Args:
        path: The file, which is replaced.
        constants: Columns that are the same in every row, after those of ``COLUMNS``.
        metadata: For the file's footer.

    Raises:
        InputError: The extra is not installed.
        OSError: The file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        *,
        constants: Mapping[str, str | None] | None = None,
        metadata: Mapping[str, str] | None = None,
    ) -> None:
        _, parquet = _libraries()
        self._constants = dict(constants or {})
        self._schema = _schema(self._constants, metadata or {})
        self._rows: list[dict[str, object]] = []
        self._writer = parquet.ParquetWriter(path, self._schema, compression="zstd")
        self.count = 0

    def add(self, items: Iterable[Item]) -> None:
        """Add measurements, as ``parse_measurement`` gives them.

        Raises:
            InputError: An item is no measurement.
            OSError: The file cannot be written.
        """
        for item in items:
            self._rows.append(row_of(item) | self._constants)
            self.count += 1
            if len(self._rows) >= _ROWS_AT_ONCE:
                self._write()

    def describe(self, metadata: Mapping[str, str]) -> None:
        """Add to what the footer says."""
        self._writer.add_key_value_metadata(dict(metadata))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self._write()
        finally:
            self._writer.close()

    def _write(self) -> None:
        if self._rows:
            self._writer.write_table(_table(self._rows, self._schema))
            self._rows.clear()


def arrow_table(rows: Iterable[dict[str, object]]) -> ArrowObject:
    """Rows with the keys of ``COLUMNS`` as a ``pyarrow.Table``, typed as in a Parquet file.

    Raises:
        InputError: The extra is not installed, or a row is no measurement.
    """
    return _table(rows, _schema({}, {}))


def _table(rows: Iterable[dict[str, object]], schema: ArrowObject) -> ArrowObject:
    pyarrow, _ = _libraries()
    try:
        return pyarrow.Table.from_pylist([row | {"time_utc": row["stamp_ns"]} for row in rows], schema=schema)
    except (pyarrow.ArrowInvalid, pyarrow.ArrowTypeError) as error:
        raise InputError("a recorded measurement is none", got=error) from error


def parquet_rows(path: Path, columns: Sequence[str]) -> Iterator[dict[str, Any]]:
    """The rows of a Parquet file that ``ParquetRows`` wrote.

    Raises:
        InputError: The extra is not installed, or the file cannot be read or has other columns.
    """
    pyarrow, parquet = _libraries()
    try:
        with parquet.ParquetFile(path) as file:
            missing = [name for name in columns if name not in file.schema_arrow.names]
            if missing:
                hint = "tables are those that `export` writes"
                raise InputError("the table has no measurements", where=path, got=f"no column {missing[0]}", hint=hint)
            for batch in file.iter_batches(_ROWS_AT_ONCE, columns=list(columns)):
                yield from batch.to_pylist()
    except (OSError, pyarrow.ArrowException) as error:
        raise InputError("the table cannot be read", where=path, got=error) from error


def parquet_metadata(path: Path) -> dict[str, str] | None:
    """Metadata in a Parquet file's footer; None where it cannot be read.

    Raises:
        InputError: The extra is not installed.
    """
    pyarrow, parquet = _libraries()
    try:
        found = parquet.read_metadata(path).metadata or {}
        return {key.decode(): value.decode() for key, value in found.items()}
    except (OSError, pyarrow.ArrowException, UnicodeDecodeError):
        return None


def _schema(constants: Mapping[str, str | None], metadata: Mapping[str, str]) -> ArrowObject:
    """The columns of ``COLUMNS``, and behind them those that are the same in every row."""
    pyarrow, _ = _libraries()
    types = {
        ColumnType.TEXT: pyarrow.string(),
        ColumnType.INTEGER: pyarrow.int64(),
        ColumnType.NUMBER: pyarrow.float64(),
        ColumnType.TIME: pyarrow.timestamp("ns", tz="UTC"),
        ColumnType.NUMBERS: pyarrow.list_(pyarrow.float64()),
        ColumnType.VECTORS: pyarrow.list_(pyarrow.list_(pyarrow.float64())),
    }
    fields = {name: types[kind] for name, kind in COLUMNS.items()} | dict.fromkeys(constants, pyarrow.string())
    return pyarrow.schema(list(fields.items()), metadata=dict(metadata))


def _libraries() -> tuple[ArrowObject, ArrowObject]:
    try:
        import pyarrow as pa  # noqa: PLC0415 - an extra
        from pyarrow import parquet  # noqa: PLC0415
    except ImportError as error:
        raise InputError("Parquet needs pyarrow", hint="install aerodft[parquet]") from error
    return pa, parquet
