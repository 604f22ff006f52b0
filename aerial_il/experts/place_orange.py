"""Expert for the orange one of two cubes."""

from aerial_il.experts.pick_place import PickPlaceExpert


class PlaceOrangeExpert(PickPlaceExpert):
    """As for the only cube of `pick_place`."""

    cube, grips = "orange_cube", ("grip_left_orange", "grip_right_orange")


EXPERT = PlaceOrangeExpert
