"""Machinery of any training run: its folder, state, signals, threads and checks of settings."""
