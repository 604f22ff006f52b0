"""Demonstrations: recorded, checked, replayed, converted, and cut into training windows. One MCAP file is the truth."""
