"""What a river's width came to, as a document, a table, maps and plates."""

from aerodft.reports.river.document import (
    RiverImages,
    contradiction_refusal,
    reach_document,
    refusal_document,
    river_document,
)
from aerodft.reports.river.files import (
    COLUMNS,
    check_folder,
    transect_map,
    transect_rows,
    write_reach,
    write_river,
)
