"""The recorder: a sink that writes a folder of MCAP segments from threads of its own."""
