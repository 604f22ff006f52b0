"""Tests of reading URDF and MJCF."""
