"""Machinery of adversarial imitation: discriminators and the rewards learned with them."""
