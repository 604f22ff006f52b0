"""The command line: ``aerial-il COMMAND key=value ...``, the only room that knows Hydra."""
