"""The camera's attitude at stamps, from gimbal reports and the vehicle's own attitude."""
