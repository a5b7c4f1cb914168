"""Calibration: what landmarks or a person know better than the telemetry."""
