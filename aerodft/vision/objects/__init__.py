"""Moving objects: detected, tracked over the ground, measured."""
