"""How a camera turned between images, and whether a fixed one was bumped."""

from aerodft.vision.camera_motion.fixed_points import LEAST_CORNERS, SteadyPoints, allowed_outside
from aerodft.vision.camera_motion.rotation import (
    FREE,
    ImagePair,
    PlaneMotion,
    PlaneTracker,
    Turns,
    layered_motion,
    plane_motion,
    turns_over_plane,
)
