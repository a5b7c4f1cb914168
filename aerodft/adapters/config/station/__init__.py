"""Station files: the telemetry, images, probes and outputs of one station."""
