"""A camera's pose and lens from what is known of a scene, by least squares."""
