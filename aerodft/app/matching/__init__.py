"""Matching images to a flight's log: by telemetry in the videos themselves, and by the log's triggers."""

from aerodft.app.matching.subtitled import over_cues, subtitled_flight, with_carrying_video, with_own_videos, with_tilt
from aerodft.app.matching.triggered import RestampedPhotos, TriggeredPhotos, triggered_photos

__all__ = [
    "RestampedPhotos",
    "TriggeredPhotos",
    "over_cues",
    "subtitled_flight",
    "triggered_photos",
    "with_carrying_video",
    "with_own_videos",
    "with_tilt",
]
