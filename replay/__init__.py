"""Recordings read again: as input of the pipeline, on the bus, side by side, and as tables and maps."""
