"""The command line: parses words, composes settings with Hydra, prints; sweeps, launchers. Nothing else knows Hydra."""
