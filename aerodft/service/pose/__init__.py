"""Poses at image stamps, composed of attitude, height and position, or the reason why there is none."""
