"""Recordings as tables, maps, videos and single files."""
