"""Widths between two banks, in one image and over a reach seen in many."""
