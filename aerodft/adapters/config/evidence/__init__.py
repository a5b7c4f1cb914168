"""Evidence files: landmarks, marks and lengths that people know of a scene, for a calibration."""
