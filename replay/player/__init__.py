"""Recordings played at a chosen pace, on the bus and on a MAVLink link."""
