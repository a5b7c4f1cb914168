"""Why a measurement has, or has not, a number."""

from enum import StrEnum


class Status(StrEnum):
    """The outcome of one measurement or pose; everything but ``OK`` comes without a value."""

    OK = "ok"
    ABOVE_HORIZON = "ABOVE_HORIZON"  # the ray never meets the ground
    OUT_OF_IMAGE = "OUT_OF_IMAGE"  # the pixel is not on the sensor
    BEYOND_LENS_MODEL = "BEYOND_LENS_MODEL"  # the distortion model has no inverse there
    BEYOND_RANGE = "BEYOND_RANGE"  # farther than the configured limit
    ILL_CONDITIONED = "ILL_CONDITIONED"  # the uncertainty is too large for a number
    STALE_TELEMETRY = "STALE_TELEMETRY"  # no telemetry close enough on both sides of the image's stamp
    NO_TELEMETRY = "NO_TELEMETRY"  # nothing received at all by then
    NOT_UPRIGHT = "NOT_UPRIGHT"  # the top of an object is seen below its base
    SELF_CROSSING = "SELF_CROSSING"  # a polygon whose sides cross has no area
    NO_HEIGHT = "NO_HEIGHT"  # no height source has a value
    NO_ATTITUDE = "NO_ATTITUDE"  # no camera attitude source has a value
    BELOW_MIN_HEIGHT = "BELOW_MIN_HEIGHT"  # on the ground, or too low to measure from
    BELOW_SURFACE = "BELOW_SURFACE"  # the measured plane is above the camera
    CAMERA_MOVED = "CAMERA_MOVED"  # a fixed camera was bumped, and where it looks is not known yet
    CLOCK_JUMPED = "CLOCK_JUMPED"  # the vehicle's or this machine's, and what time it is has not settled yet
    BEYOND_TERRAIN = "BEYOND_TERRAIN"  # the ray leaves the elevation model before it meets the ground
    NO_ELEVATION = "NO_ELEVATION"  # the elevation model has a hole where the ray passes
    UNHEALTHY = "UNHEALTHY"  # the vehicle itself says that its estimate is wrong
    OCCLUDED = "OCCLUDED"  # what moves is hidden: there is a place that its motion foretells, and no value
    LOST = "LOST"  # what is tracked was not found again in the image
    CAMERA_ZOOMED = "CAMERA_ZOOMED"  # not as in its file, and by how much is not known
    NOT_SEEN = "NOT_SEEN"  # it was looked for in the image, and is not there or cannot be told


CODES: tuple[Status, ...] = tuple(Status)
"""Arrays hold a status as its index here."""

CODE_OF: dict[Status, int] = {status: code for code, status in enumerate(CODES)}
"""The index in ``CODES``."""
