"""A recording as input again: its configuration, messages and pixels."""
