"""Biases of a flight's telemetry, from landmarks in many images."""
