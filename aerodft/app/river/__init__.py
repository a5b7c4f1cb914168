"""Surveying a river: its width along it, from an image, a recording or a video."""

from aerodft.app.river.images import filmed_images, is_recording, recorded_images
from aerodft.app.river.survey import (
    MOST_IMAGES,
    VIDEO_SUFFIXES,
    RiverSurvey,
    Transects,
    river_question,
    survey_image,
    survey_images,
    survey_river,
    survey_still,
)
