"""Recordings in rerun, as we want them seen: the real scene in motion, its forces, and every signal on one timeline."""
