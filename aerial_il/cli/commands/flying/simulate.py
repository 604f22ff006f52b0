"""Serve a robot of the suite over a link, in real time, until Ctrl-C.

It stands in its cradle until it is armed and takes off, follows set points at several levels, and hovers where it hears
none for 0.2 s. Whoever speaks the link flies it: aerial-il fly, aerial_il.vehicle, or programs of your own.

Example: aerial-il simulate link=ros2 robot=ua_quad_arm4 task=pick_place
Example: aerial-il simulate link=mavlink robot=big_four_z1 task=reach tier=gusts
"""

from aerial_il.workflows.simulate import Simulate, simulate

SETTINGS = Simulate


def run(settings: Simulate) -> None:
    """Serve it until interrupted."""
    simulate(settings)
