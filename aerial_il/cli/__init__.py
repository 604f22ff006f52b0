"""The command line: reads words in the grammar of Hydra, prints; sweeps, launchers. Nothing else knows Hydra."""
