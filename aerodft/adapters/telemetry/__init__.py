"""Telemetry logs and links, whatever their format, decoded to tracks in SI units."""
