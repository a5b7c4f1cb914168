"""Clocks: the vehicle's since boot, this machine's and the camera's, each mapped to UTC."""
