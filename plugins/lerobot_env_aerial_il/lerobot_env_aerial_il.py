"""Registers the environments of aerial_il with lerobot, which imports this module because of its name."""

import aerial_il.suite.faces.lerobot.env  # noqa: F401
