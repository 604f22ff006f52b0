"""Arms and vehicles out of files that describe them: URDF and MJCF, read without trusting them."""
