"""Expert for the green one of two cubes."""

from aerial_il.experts.pick_place import PickPlaceExpert


class PlaceGreenExpert(PickPlaceExpert):
    """As for the only cube of `pick_place`."""

    cube, grips = "green_cube", ("grip_left_green", "grip_right_green")


EXPERT = PlaceGreenExpert
