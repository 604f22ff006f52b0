"""The study of pixels: each policy beside its blind control, from the same demonstrations."""

from __future__ import annotations

from experiments.pixels import study as pixels


def test_a_target_asks_for_more_than_the_blind_reach() -> None:
    seeing = {"task": "reach", "sees": "images", "percent": 60.0, "flights_low": 50.0, "flights_high": 69.0}
    seeing |= {"trainings_low": None, "trainings_high": None}
    blind = {**seeing, "sees": "blind", "percent": 40.0, "flights_high": 49.0}
    assert [target.met for target in pixels.targets_of([seeing, blind])] == [True]
    assert [target.met for target in pixels.targets_of([seeing, {**blind, "flights_high": 51.0}])] == [False]
