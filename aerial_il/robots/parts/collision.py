"""Collision groups: robots collide with the world but not with themselves; objects collide with everything.

The parts of a fixture (a door and its frame) touch robots and objects, but not each other: joints hold them together.
What marks the end of an object (see :func:`aerial_il.suite.props.peg.add_peg`) touches what objects lie on, no more, or
the floor of a socket, which touches nothing else.
"""

from __future__ import annotations

WORLD = {"contype": 1 | 4, "conaffinity": 3}
FIXTURE = {"contype": 1, "conaffinity": 2}
END = {"contype": 0, "conaffinity": 4}
UNDER_ENDS = {"contype": 4, "conaffinity": 0}
ROBOT = {"contype": 2, "conaffinity": 1}
NOTHING = {"contype": 0, "conaffinity": 0}
