"""Speed: arms that are timed in turns, and the work that they are given."""
