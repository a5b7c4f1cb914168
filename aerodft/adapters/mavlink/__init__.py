"""MAVLink and DataFlash: bytes from links and logs, framed strictly, decoded to telemetry tracks."""
