"""Messages out of MCAP segments, as far as these are whole."""
