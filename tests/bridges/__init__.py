"""Tests of the faces that other frameworks look for."""
