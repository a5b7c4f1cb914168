"""Damaged and unfinished recordings made whole in place."""
