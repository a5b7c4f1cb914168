"""Status of a measurement or pose: why it has, or has not, a value."""

from enum import StrEnum


class Status(StrEnum):
    """Status of a measurement or pose; all but ``OK`` come without a value.

    Beside each its cause, below it what to do; the site shows both.
    """

    OK = "ok"
    ABOVE_HORIZON = "ABOVE_HORIZON"  # the ray never meets the ground
    # Cure: choose a pixel below the horizon; if it is below, tilt or roll are wrong.
    OUT_OF_IMAGE = "OUT_OF_IMAGE"  # the pixel is not on the sensor
    # Cure: choose one from -0.5 to width - 0.5 and height - 0.5 of the camera file.
    BEYOND_LENS_MODEL = "BEYOND_LENS_MODEL"  # the distortion model has no inverse there
    # Cure: choose a pixel nearer to the middle, or calibrate the lens to its corners.
    BEYOND_RANGE = "BEYOND_RANGE"  # farther than the configured limit
    # Cure: look steeper, or raise limits.max_range_m.
    ILL_CONDITIONED = "ILL_CONDITIONED"  # the uncertainty is too large for a number
    # Cure: look steeper, or state better stds of height and tilt.
    STALE_TELEMETRY = "STALE_TELEMETRY"  # no telemetry close enough on both sides of the image's stamp
    # Cure: raise the messages' rates, as aerodft doctor says, or mend the clock offset with aerodft sync.
    NO_TELEMETRY = "NO_TELEMETRY"  # nothing received at all by then
    # Cure: check the connection; images before the first message have no pose.
    NOT_UPRIGHT = "NOT_UPRIGHT"  # the top of an object is seen below its base
    # Cure: give the base first, then the top.
    SELF_CROSSING = "SELF_CROSSING"  # a polygon whose sides cross has no area
    # Cure: give its corners in their order around it.
    NO_HEIGHT = "NO_HEIGHT"  # no height source has a value
    # Cure: have one of telemetry.height.order sent, or state manual_m.
    NO_ATTITUDE = "NO_ATTITUDE"  # no camera attitude source has a value
    # Cure: have a gimbal's attitude sent, or state fixed_mount; aerodft doctor says what came.
    BELOW_MIN_HEIGHT = "BELOW_MIN_HEIGHT"  # on the ground, or too low to measure from
    # Cure: fly higher than telemetry.height.min_m, or check home_above_plane_m.
    BELOW_SURFACE = "BELOW_SURFACE"  # the measured plane is above the camera
    # Cure: check elevation_m and the height.
    CAMERA_MOVED = "CAMERA_MOVED"  # a fixed camera was bumped, and where it looks is not known yet
    # Cure: wait for three looks, then fixed pixels follow the ground; if it stays, calibrate anew.
    CLOCK_JUMPED = "CLOCK_JUMPED"  # the vehicle's or this machine's, and what time it is has not settled yet
    # Cure: wait; have clocks set before the flight.
    BEYOND_TERRAIN = "BEYOND_TERRAIN"  # the ray leaves the elevation model before it meets the ground
    # Cure: take a larger model or radius_m.
    NO_ELEVATION = "NO_ELEVATION"  # the elevation model has a hole where the ray passes
    # Cure: state fill_msl_m, the height of the water for instance.
    UNHEALTHY = "UNHEALTHY"  # the vehicle says that its estimate is wrong, or its heights contradict its motion
    # Cure: see the reasons, and the vehicle's compass, GPS, barometer and vibration.
    OCCLUDED = "OCCLUDED"  # what moves is hidden: there is a place that its motion foretells, and no value
    # Cure: none is needed, it is seen again or given up.
    LOST = "LOST"  # what is tracked was not found again in the image
    # Cure: click it in an image in which more of the bank is seen.
    CAMERA_ZOOMED = "CAMERA_ZOOMED"  # not as in its file, and by how much is not known
    # Cure: zoom back, or give telemetry.zoom.curve.
    NOT_SEEN = "NOT_SEEN"  # it was looked for in the image, and is not there or cannot be told
    # Cure: the reason says what was missing; a seed in the water helps a river.
    NO_LEVEL = "NO_LEVEL"  # no reading of the water's level close enough to the image's stamp
    # Cure: add the gauge's readings of that time to ground.level, or raise ground.level_max_gap_s.


CODES: tuple[Status, ...] = tuple(Status)
"""Statuses in the order of their codes; arrays hold codes."""

CODE_OF: dict[Status, int] = {status: code for code, status in enumerate(CODES)}
"""Code of a status: its index in ``CODES``."""
