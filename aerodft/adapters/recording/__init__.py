"""Recordings as MCAP segments: written so that a crash costs half a second, read as far as they are whole."""
