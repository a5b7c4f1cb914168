"""Messages that other tools record: raw MAVLink in its wrappings, compressed images and video, cameras, places."""
