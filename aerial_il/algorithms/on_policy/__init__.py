"""On-policy learning: groups of settings, the one loop that is called, and learning that starts from a clone."""
