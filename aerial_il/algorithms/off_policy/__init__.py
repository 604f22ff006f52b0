"""Off-policy learning: groups of settings, the one loop that is called, and what a run learns on."""
