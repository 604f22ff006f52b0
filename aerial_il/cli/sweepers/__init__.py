"""Sweepers, one file each: which points of a space are tried next. Without one a sweep tries every combination.

A sweeper is a dataclass of settings, ``sweeper.KEY=VALUE``, with a method ``search``.
"""
