"""The paper's tables and figures, recomputed from its printed inputs; its model beside the pinhole's."""

from aerodft.dft.paper.models import ModelDifference, compare_models
from aerodft.dft.paper.tables import (
    CANON,
    FIGURE_14_ERROR_M,
    MAX_DEPTH_M,
    TABLE_1,
    TABLE_2_HEIGHT_M,
    TABLE_2_TILT_RAD,
    CameraRow,
    DepthRow,
    ErrorCurve,
    Percent,
    Sensitivity,
    SensitivityRow,
    figure_12,
    figure_14,
    figure_14_text_depth,
    table_1,
    table_2,
    table_3,
)
