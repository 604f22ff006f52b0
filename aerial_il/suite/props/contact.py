"""How the surfaces of props behave in contact."""

from __future__ import annotations

GRASPABLE = {
    "friction": [1.2, 0.02, 0.001],
    "solref": [0.01, 1.0],
    "solimp": [0.95, 0.99, 0.001, 0.5, 2.0],
    "condim": 4,
}
STICTION = [0.99, 0.999, 0.001, 0.5, 2.0]  # of a joint's dry friction: at the defaults it creeps under a small load
