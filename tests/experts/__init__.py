"""Tests of the scripted experts."""
