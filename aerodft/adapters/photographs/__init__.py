"""Photographs that carry their pose: EXIF and XMP of drones, by dialects that say what their numbers mean."""

from aerodft.adapters.photographs.dialect import Dialect, LaserTarget, PhotoPose
from aerodft.adapters.photographs.lens import StatedLens, lens_of_tags
from aerodft.adapters.photographs.makers import DIALECTS
from aerodft.adapters.photographs.reading import pose_of_tags
from aerodft.adapters.photographs.selection import Photo, of_one_flight
from aerodft.adapters.photographs.tags import PhotoTags, photo_tags
