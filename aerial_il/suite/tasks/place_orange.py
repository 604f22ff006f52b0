"""Place the orange cube of two: which one is meant is a matter of the instruction alone."""

from __future__ import annotations

from aerial_il.core.kernels import kernel
from aerial_il.suite.tasks.two_cubes import OTHER, TwoCubes, kernels_with, names_of, observe_both


class PlaceOrange(TwoCubes):
    """The orange cube released in the bowl as in `pick_place`, the green one not in it, for 0.5 s.

    Letting go of the green one in the bowl ends the episode as dropped, as does an orange one out of reach. Scene and
    observation are those of `place_green`.
    """

    name = "place_orange"
    instruction = "Of the two cubes, put the orange one into the bowl."
    wordings = (
        "Put the orange one of the two cubes in the bowl.",
        "There are two cubes: place the orange one in the bowl.",
        "两个方块中，把橙色的那个放进碗里。",
        "从两个方块里选橙色的，放入碗中。",
    )
    held_out = ("Of two cubes, the orange one goes into the bowl.", "两个方块，请把橙色的放进碗。")
    names = names_of("orange", "green")


@kernel
def observe(world, found):
    observe_both(world, found, 0, OTHER)


TASK = PlaceOrange(kernels_with(observe))
