"""Images: video files, stills, live streams, and stamps alone."""
