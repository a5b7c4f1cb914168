"""Camera and calibration files: lens, telemetry biases, and the pose of a fixed camera."""
