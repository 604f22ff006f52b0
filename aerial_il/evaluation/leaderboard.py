"""Standings of methods, from the records of their evaluations alone: robot, task, tier, method, success, cost.

Results that differ in no more than the training's draw are trainings of one method; other settings, or another way to
be flown or told, make another. What was flown with another version of the engine, over fewer seeds than the others, or
over seeds that the same policy has flown already, stands in no table with the rest; it is named with the reason.
"""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerial_il.core.seeding import named_rng
from aerial_il.evaluation import statistics
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.statistics import Interval
from aerial_il.evaluation.training_run import PLACES, TrainingRun

TRAINED = "trained"  # key of an evaluation's provenance: how the policy came about
FEWEST = 50  # episodes of a result that stands on the board
MOST_SETTINGS = 3  # that tell methods of one name apart
HOW_FLOWN = ("controller", "execution", "instruction")  # of the environment


@dataclass(frozen=True)
class Standing:
    """One method in one cell and tier.

    Attributes:
        robot, task, tier, method: what was flown. trainings, episodes: how many of each. rate: of success.
        ci95: its 95 % interval: Wilson's, over trainings and seeds where there are several trainings of the same seeds.
        demonstrations: that each learned from; None where nothing says so. minutes: mean wall time of the training.
        commands: that fly it again.
    """

    robot: str
    task: str
    tier: str
    method: str
    trainings: int
    episodes: int
    rate: float
    ci95: Interval
    demonstrations: int | None
    minutes: float | None
    commands: tuple[str, ...]


@dataclass(frozen=True)
class Leaderboard:
    """Standings, the best first within each cell and tier, and what is left out.

    Attributes:
        engine: version of the engine that all of it was flown with. standings: in order.
        left_out: place of a result -> why it does not stand here.
    """

    engine: str
    standings: tuple[Standing, ...]
    left_out: Mapping[str, str]

    @property
    def cells(self) -> dict[tuple[str, str], dict[str, list[Standing]]]:
        """(robot, task) -> tier -> standings."""
        found: dict[tuple[str, str], dict[str, list[Standing]]] = {}
        for each in self.standings:
            found.setdefault((each.robot, each.task), {}).setdefault(each.tier, []).append(each)
        return found


def trained(run: TrainingRun) -> dict[str, Any]:
    """Return what a result keeps of how its policy came about: method, settings, demonstrations, wall time."""
    dataset, places = run.config.get("dataset", {}), [f"dataset.{name}" for name in PLACES]
    return {
        "algorithm": run.algorithm,
        "policy": run.policy,
        "demonstrations": dataset.get("demonstrations") if isinstance(dataset, Mapping) else None,
        "seconds": None if run.seconds is None else round(run.seconds, 1),
        "settings": {key: value for key, value in run.settings.items() if key not in places},
    }


def standings(results: Mapping[str, EvaluationResult], *, fewest: int = FEWEST) -> Leaderboard:
    """Return the standings of results.

    Args:
        results: place -> evaluation. fewest: episodes that a result needs.
    """
    engines = Counter(str(result.provenance.get("engine")) for result in results.values())
    engine = max(engines, key=lambda each: (engines[each], each), default="")
    left_out, groups = dict[str, str](), dict[tuple[str, str, str, str], list[EvaluationResult]]()
    seen: dict[str, dict[int, str]] = {}  # what was flown -> seed -> place
    for place in sorted(results, key=lambda each: -len(results[each].episodes)):
        result = results[place]
        cell = (result.robot, result.task, result.tier)
        flown = seen.setdefault(_text([*cell, _identity(result), _what(result)]), {})
        reason = _unfit(result, engine, fewest) or _flown_before(result, flown)
        if reason:
            left_out[place] = reason
            continue
        flown |= dict.fromkeys(result.seeds, place)
        groups.setdefault((*cell, _text([_name(result), _how(result)])), []).append(result)
    names = _told_apart([group[0] for group in groups.values()])
    found = [_standing(*key[:3], name, group) for (key, group), name in zip(groups.items(), names, strict=True)]
    order = sorted(found, key=lambda each: (each.robot, each.task, each.tier, -each.rate, each.method))
    return Leaderboard(engine, tuple(order), left_out)


def _flown_before(result: EvaluationResult, flown: Mapping[int, str]) -> str:
    """Return which place has flights of ``result`` already; empty if none has."""
    place = next((flown[seed] for seed in result.seeds if seed in flown), None)
    if place is None:
        return ""
    shared = sum(flown.get(seed) == place for seed in result.seeds)
    return f"is {place} again" if shared == len(result.seeds) else f"has {shared} seeds of {place} again"


def _unfit(result: EvaluationResult, engine: str, fewest: int) -> str:
    """Return why a result does not stand on the board; empty if it does."""
    environment = result.provenance.get("environment", {})
    if str(result.provenance.get("engine")) != engine:
        return f"was flown with version {result.provenance.get('engine')} of the engine, the others with {engine}"
    if len(result.episodes) < fewest:
        return f"has {len(result.episodes)} episodes; {fewest} are needed"
    if environment.get("options"):
        return "was flown in an environment from outside"
    if late := environment.get("latency"):
        return f"was flown with latency of its own, {late}"
    return ""


def _identity(result: EvaluationResult) -> str:
    return str(result.provenance.get("policy_sha256") or result.policy)


def _what(result: EvaluationResult) -> dict[str, Any]:
    """Return how a policy flew and, of one without weights that tell it from others, what is known of its training."""
    return _flown(result) if result.provenance.get("policy_sha256") else _how(result)


def _name(result: EvaluationResult) -> str:
    """Return a method's name for people, which others may have too."""
    how, seen = result.provenance.get(TRAINED), result.provenance.get("observations")
    onboard = ", onboard" if seen == "onboard" else ""
    if not isinstance(how, Mapping):
        return f"{result.policy}{onboard}"
    known = {"bc": ""}.get(str(how.get("algorithm")), f", {how.get('algorithm')}")
    return f"{how.get('policy')}{known}{onboard}, {how.get('demonstrations') or 'no'} demonstrations"


def _how(result: EvaluationResult) -> dict[str, Any]:
    """Return what makes a method: settings of its training, and how it is flown and told."""
    trained = result.provenance.get(TRAINED)
    settings = trained.get("settings", {}) if isinstance(trained, Mapping) else {}
    return {**settings, **_flown(result)}


def _flown(result: EvaluationResult) -> dict[str, Any]:
    environment = result.provenance.get("environment", {})
    return {name: environment[name] for name in HOW_FLOWN if name in environment}


def _told_apart(results: Sequence[EvaluationResult]) -> list[str]:
    """Return the names of methods, those of one name in one cell and tier with the settings in which they differ."""
    names = []
    for one in results:
        rivals = [
            _how(other)
            for other in results
            if (other.robot, other.task, other.tier, _name(other)) == (one.robot, one.task, one.tier, _name(one))
        ]
        keys = sorted({key for how in rivals for key in how if any(h.get(key) != how[key] for h in rivals)})
        said = [f"{key.rpartition('.')[2]}={_how(one).get(key)}" for key in keys[:MOST_SETTINGS]]
        names.append(", ".join([_name(one), *said, *["..."][: len(keys) > MOST_SETTINGS]]))
    return names


def _text(parts: Any) -> str:
    return json.dumps(parts, sort_keys=True, default=str)


def _standing(robot: str, task: str, tier: str, method: str, results: Sequence[EvaluationResult]) -> Standing:
    won = [np.array([episode.success for episode in result.episodes], float) for result in results]
    count, total = int(sum(each.sum() for each in won)), sum(each.size for each in won)
    if len({tuple(result.seeds) for result in results}) == 1:
        rng = named_rng(0, "leaderboard", robot, task, method)
        ci95 = statistics.success_of_trainings(np.array(won), rng=rng)
    else:
        seeds = len({seed for result in results for seed in result.seeds})
        ci95 = statistics.wilson_of_rate(count / total, seeds)  # flights of one seed are not independent
    how = [result.provenance.get(TRAINED, {}) for result in results]
    seconds = [each["seconds"] for each in how if each.get("seconds") is not None]
    commands = dict.fromkeys(str(result.provenance.get("command", "")) for result in results)
    return Standing(
        robot=robot, task=task, tier=tier, method=method, trainings=len({*map(_identity, results)}), episodes=total,
        rate=count / total, ci95=ci95, demonstrations=how[0].get("demonstrations"),
        minutes=round(sum(seconds) / len(seconds) / 60, 1) if seconds else None,
        commands=tuple(command for command in commands if command),
    )  # fmt: skip
