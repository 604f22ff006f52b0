"""Preferences: which of two pieces of flight is the better one, as a script or a person says."""
