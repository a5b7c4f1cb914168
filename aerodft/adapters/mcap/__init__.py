"""Recordings: MCAP segments written so that a crash costs half a second, and read as far as they are whole."""
