"""Tests of the controllers against MuJoCo and against themselves."""
