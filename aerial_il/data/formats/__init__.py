"""Formats of others: LeRobot v3, robomimic's HDF5, and Rerun."""
