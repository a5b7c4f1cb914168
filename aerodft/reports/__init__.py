"""Figures and documents: values in, files out."""
