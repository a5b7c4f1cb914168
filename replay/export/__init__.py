"""Recordings as tables, maps, videos and single files."""

from replay.export.formats import (
    MAP_FORMATS,
    TEXT_FORMATS,
    ExportFormat,
    ParquetRows,
    arrow_table,
    export_text,
    parquet_metadata,
    parquet_rows,
)
from replay.export.maps import MapCrs, MapFeature, geojson_text, map_features, write_geopackage, write_kml
from replay.export.merging import merge_segments
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
