"""The configuration of a command: its keys, its groups and their choices, composed by Hydra, built into objects."""
