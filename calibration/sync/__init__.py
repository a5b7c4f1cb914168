"""A video aligned with a log by how the camera turned."""
