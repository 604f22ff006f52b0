"""Demonstrations: recorded, read, checked, replayed, converted, cut into windows. One MCAP file is the truth."""
