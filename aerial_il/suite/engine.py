"""The version of the simulation engine: physics settings, solver flags and models, whatever changes bits.

A recording is flown again, bit for bit, only by the engine that made it; it is read for training by every one. To be
raised by whoever changes what a bit of a flight depends on.
"""

from __future__ import annotations

# 1: recordings do not name it. 2, never released: solver from rest, no islands, hard tables. 3: grips without torsion.
# 4: rotors push as a wrench of the flight loop, and the arm gives way to what the tool is pressed against.
ENGINE = "4"
