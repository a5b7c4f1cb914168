"""Recordings as tables, maps, videos and single files."""

from replay.export.merging import merge_segments
from replay.export.parquet import ParquetRows, arrow_table, parquet_metadata, parquet_rows
from replay.export.table import (
    COLUMNS,
    LARGEST_NUMBER,
    TEXT_FORMATS,
    ExportFormat,
    Item,
    Kind,
    check_on_earth,
    export_text,
    parsed,
    row_of,
    time_utc,
)
from replay.export.video import Overlay, measured_images, write_video
