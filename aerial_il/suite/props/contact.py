"""Contact parameters of the surfaces of props."""

from __future__ import annotations

# Of what objects fall on, whatever they are made of. The time constant, two physics steps, is the least that MuJoCo
# takes: it stops an object in the step after the one in which it arrived, before its middle is past the surface. Beyond
# critical damping, it is then let out slowly instead of thrown.
HARD = {"solref": [0.008, 1.5], "solimp": [0.95, 0.99, 0.001, 0.5, 2.0], "solmix": 1e3}
GRASPABLE = {
    "friction": [1.2, 0.02, 0.001],
    "solref": [0.01, 1.0],
    "solimp": [0.95, 0.99, 0.001, 0.5, 2.0],
}
STICTION = [0.99, 0.999, 0.001, 0.5, 2.0]  # of a joint's dry friction: at the defaults it creeps under a small load
