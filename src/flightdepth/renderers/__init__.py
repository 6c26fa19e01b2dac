"""Scene and camera poses in, RGB and z-depth out."""
