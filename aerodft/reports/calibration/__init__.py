"""Calibrations as documents, pages, pictures and plots."""

from aerodft.reports.calibration.document import (
    calibration_document,
    calibration_notes,
    decimals,
    displayed_covariance,
    displayed_values,
    values_of,
    write_calibration_page,
)
from aerodft.reports.calibration.marks import Mark, rows_of
