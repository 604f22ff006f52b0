"""What the manoeuvres of pilots amount to: rows of tables, and the numbers of the figures.

``flown`` is pilot -> what its trainings flew, each: ``responses``, ``push``, ``held``, ``mismatch``, ``decision_us``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from aerial_il.suite.timing import CONTROL_DT_S
from experiments.common.report import Row
from experiments.flight_control.manoeuvres import STEPS, recovery_s, response_of
from experiments.flight_control.pilots import ROBOT

HELD_IN = ("calm", "gusts", "hard")
MASSES, MOTORS = (0.8, 0.9, 1.1, 1.2, 1.3, 1.4), (0.95, 0.9, 0.85, 0.8, 0.75, 0.7)
DRAWN_EVERY = 2
MOSTLY = 0.5  # share of crashed flights beyond which a distance says nothing


def manoeuvre_tables(flown: Mapping[str, list[dict[str, Any]]]) -> dict[str, list[Row]]:
    """Return the tables of the manoeuvres: pilots by name, each with the figures of its trainings."""
    return {
        "Step responses": [_response_row(name, step, all_) for name, all_ in flown.items() for step in STEPS],
        "Push": [_push_row(name, all_) for name, all_ in flown.items()],
        "Holding": [
            {"flown_by": name, "tier": tier, **_mean_held([one["held"][tier] for one in all_])}
            for name, all_ in flown.items()
            for tier in HELD_IN
        ],
        "Mismatch": [
            {"flown_by": name, "vehicle": what, **_mean_held([one["mismatch"][what] for one in all_])}
            for name, all_ in flown.items()
            for what in all_[0]["mismatch"]
        ],
        "Decisions": [
            {"flown_by": name, "us": round(float(np.mean([one["decision_us"] for one in all_])), 1)}
            for name, all_ in flown.items()
        ],
    }


def _response_row(name: str, step: str, flown: list[dict[str, Any]]) -> Row:
    responses = [asdict(response_of(np.array(one["responses"][step]))) for one in flown]
    return {"flown_by": name, "step": step, **{key: _mean([r[key] for r in responses]) for key in responses[0]}}


def _push_row(name: str, flown: list[dict[str, Any]]) -> Row:
    away = [np.array(one["push"], float) for one in flown]  # not a number from a crash on
    farthest = _mean([100.0 * float(each.max()) for each in away])
    return {"flown_by": name, "farthest_cm": farthest, "recovered_s": _mean([recovery_s(each) for each in away])}


def _mean_held(held: list[dict[str, float | None]]) -> dict[str, float | None]:
    return {key: _mean([one[key] for one in held], digits=3) for key in held[0]}


def _mean(values: list[float | None], *, digits: int = 2) -> float | None:
    """Return the mean; None if any is missing or not a number: one that fails is not averaged away."""
    if any(value is None or not np.isfinite(value) for value in values):
        return None
    return round(float(np.mean([value for value in values if value is not None])), digits)


def drawn_responses(flown: Mapping[str, list[dict[str, Any]]]) -> dict[tuple[str, str], dict[str, list[float]]]:
    """Return the responses to be drawn, in percent: (robot, step) -> pilot -> values, mean of the trainings."""
    return {
        (ROBOT, step): {
            name: (100.0 * np.mean([one["responses"][step] for one in all_], 0)[::DRAWN_EVERY]).round(2).tolist()
            for name, all_ in flown.items()
        }
        for step in STEPS
    }


def by_mismatch(flown: Mapping[str, list[dict[str, Any]]]) -> dict[str, dict[str, list[tuple[float, float, bool]]]]:
    """Return what -> pilot -> (factor, RMSE in cm, whether any flight crashed), where no more than half crashed."""
    panels: dict[str, dict[str, list[tuple[float, float, bool]]]] = {}
    for what, factors in (("mass", (1.0, *MASSES)), ("motor", (1.0, *MOTORS))):
        for name, all_ in flown.items():
            keys = {factor: "nominal" if factor == 1.0 else f"{what} {factor}" for factor in sorted(factors)}
            means = {factor: _mean_held([one["mismatch"][key] for one in all_]) for factor, key in keys.items()}
            panels.setdefault(what, {})[name] = [
                (factor, mean["rmse_cm"], bool(mean["crashed"]))
                for factor, mean in means.items()
                if mean["rmse_cm"] and (mean["crashed"] or 0.0) <= MOSTLY
            ]
    return panels


def drawn_times() -> list[float]:
    """Return the times, in s, of the responses to be drawn."""
    return [round(CONTROL_DT_S * (k + 1), 3) for k in range(200)[::DRAWN_EVERY]]
