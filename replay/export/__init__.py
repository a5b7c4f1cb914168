"""Recordings as tables, maps, videos and single files."""

from replay.export.exporters import EXPORTERS, Exporter, MapExporter
from replay.export.maps import MapCrs, MapFeature, geojson_text, map_features
from replay.export.parquet import ParquetRows, arrow_table, parquet_metadata, parquet_rows
from replay.export.table import (
    COLUMNS,
    LARGEST_NUMBER,
    ColumnType,
    Item,
    check_on_earth,
    digits_of,
    parse_measurement,
    row_of,
    time_utc,
    written_unit,
)
from replay.export.video import COLOURS, Overlay, best_image, measured_images, write_video
