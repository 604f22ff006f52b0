"""Runs, flights and datasets as frames and figures."""
