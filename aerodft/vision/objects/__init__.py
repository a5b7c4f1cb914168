"""Moving objects: detected, tracked over the ground, measured."""

from aerodft.vision.objects.moving import MovingObjects, MovingOverGround
from aerodft.vision.objects.object_tracks import ObjectTracks
