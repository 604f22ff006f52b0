"""Who touches whom: robots collide with the world but not with themselves; objects collide with everything."""

from __future__ import annotations

WORLD = {"contype": 1, "conaffinity": 3}
ROBOT = {"contype": 2, "conaffinity": 1}
NOTHING = {"contype": 0, "conaffinity": 0}
