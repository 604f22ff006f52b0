"""Place the green cube of two: which one is meant is a matter of the instruction alone."""

from __future__ import annotations

from aerial_il.core.kernels import kernel
from aerial_il.suite.tasks.two_cubes import OTHER, TwoCubes, kernels_with, names_of, observe_both


class PlaceGreen(TwoCubes):
    """The green cube released in the bowl as in `pick_place`, the orange one not in it, for 0.5 s.

    Letting go of the orange one in the bowl ends the episode as dropped, as does a green one out of reach. Scene and
    observation are those of `place_orange`.
    """

    name = "place_green"
    instruction = "Of the two cubes, put the green one into the bowl."
    wordings = (
        "Put the green one of the two cubes in the bowl.",
        "There are two cubes: place the green one in the bowl.",
        "两个方块中，把绿色的那个放进碗里。",
        "从两个方块里选绿色的，放入碗中。",
    )
    held_out = ("Of two cubes, the green one goes into the bowl.", "两个方块，请把绿色的放进碗。")
    names = names_of("green", "orange")


@kernel
def observe(world, found):
    observe_both(world, found, OTHER, 0)


TASK = PlaceGreen(kernels_with(observe))
