"""A camera's pose and lens by least squares from evidence of a scene."""

from calibration.pose.residuals import OUT_OF_SIGHT, Problem, ground_error_m
from calibration.pose.result import (
    LIMIT,
    Observability,
    ObservationResidual,
    Outcome,
    Result,
    above_ground,
    angles_deg,
    calibrate,
    checked_unknowns,
    correlations,
    describe_weakness,
    display_unit,
    natural_size,
    possible_unknowns,
    residuals_of,
    rms_px,
    start_state,
    unknowns_of,
)
from calibration.pose.solve import ROBUST, Fit, goodness, without_outliers
from calibration.pose.state import (
    BOUNDS,
    State,
    Unknowns,
    coefficient_names,
    expand_groups,
    possible_coefficients,
    with_coefficients,
)
