"""Recordings of ours: the layout of their MCAP files, and what writes, reads and scans them."""
