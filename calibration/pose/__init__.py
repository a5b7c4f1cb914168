"""A camera's pose and lens from what is known of a scene, by least squares."""

from calibration.pose.descent import Loss, NormalEquations, Rows, descend, eliminated, own_steps
from calibration.pose.residuals import OUT_OF_SIGHT, Problem, Residuals, joined
from calibration.pose.result import (
    LIMIT,
    Observability,
    ObservationResidual,
    Outcome,
    Result,
    above_ground,
    angles_deg,
    calibrate,
    combined,
    correlations,
    display_unit,
    each_possible,
    ground_error_m,
    natural_size,
    possible_unknowns,
    residuals_of,
    rms_px,
    start_state,
    unknowns_of,
)
from calibration.pose.solve import ROBUST, Fit, covariance_of, goodness, without_outliers
from calibration.pose.state import (
    BOUNDS,
    State,
    Unknowns,
    coefficient_names,
    expanded,
    possible_coefficients,
    with_coefficients,
)
