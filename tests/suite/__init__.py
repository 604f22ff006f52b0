"""Tests of the suite: physics, faces, errors."""
