"""References that a vehicle is asked to follow, and how well it does."""
