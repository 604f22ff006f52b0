"""Machinery of learning in rounds with an expert at hand: gates, mixtures, rounds of flying and training."""
