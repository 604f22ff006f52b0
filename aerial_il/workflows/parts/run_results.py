"""Contents of a run's report besides metrics: predictions along demonstrations, a learned reward, films of flights."""

from __future__ import annotations

import os
from collections.abc import Collection, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from aerial_il.core.checkpoint import is_sealed, sealed_digest
from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.evaluation.training_run import BEST, FINAL, TrainingRun
from aerial_il.presentation.films.video import Footage, film
from aerial_il.workflows.parts import pilots, results

if TYPE_CHECKING:
    import numpy as np

    from aerial_il.core.specs import EnvSpec
    from aerial_il.data.episode import Episode
    from aerial_il.evaluation.predictions import Prediction

SHOWN = 2  # held-out demonstrations with predictions
FILMED_SEED, FLOWN = 5000, 10  # seeds flown for films where no evaluation has any


def predictions(run: TrainingRun, dataset: str | None) -> tuple[list[Prediction], str]:
    """Return predictions along the first held-out demonstrations, or why there are none."""
    from aerial_il.evaluation.predictions import predict
    from aerial_il.policies import load_policy

    try:
        policy = load_policy(run.path)
        return [predict(policy, episode) for episode in _held_out(run, dataset)[:SHOWN]], ""
    except AerialError as error:
        return [], f"No predictions: {error}"


def _held_out(run: TrainingRun, dataset: str | None) -> Sequence[Episode]:
    """Return the episodes that ``run`` held out, once it is certain that the dataset is the same still."""
    from aerial_il.workflows.parts.learned_from import learned_from

    if held_out := learned_from(run, dataset).held_out:
        return held_out
    raise InvalidValueError("no demonstration was held out. See algorithm.validation.")


def _dataset_of(run: TrainingRun, dataset: str | None) -> str | None:
    """Return what the user named, else what the run was started with."""
    return dataset or run.command.get("dataset", {}).get("path")


def rewarded(run: TrainingRun, dataset: str | None) -> dict[str, dict[str, np.ndarray]]:
    """Return uid -> label -> learned reward along the first demonstration; empty without such a reward or dataset."""
    from aerial_il.algorithms.run.folder import REWARD
    from aerial_il.data.dataset import open_dataset

    path = _dataset_of(run, dataset)
    if path is None or not (run.path / REWARD).is_dir():
        return {}
    try:
        episode = open_dataset(path)[0]
        return {episode.uid: paid_along(run.path, episode)}
    except AerialError:
        return {}


def paid_along(run: str | os.PathLike[str], episode: Episode) -> dict[str, np.ndarray]:
    """Return what the reward learned by ``run`` pays for each step, (T,), as flown and with the actions shuffled."""
    from aerial_il.algorithms.adversarial.reward_net import reward_along, shuffled

    flights = {"as flown": episode, "actions shuffled": shuffled(episode)}
    return {label: reward_along(run, flight) for label, flight in flights.items()}


def flown_by_others(run: TrainingRun) -> set[str]:
    """Return the evaluations in a run's folder that none of the weights in it flew: it may have been trained anew."""
    from aerial_il.evaluation.rollouts import weights_of
    from aerial_il.policies import load_policy

    here = set[str | None]()
    for place in (run.path / FINAL, run.path / BEST):
        if is_sealed(place):
            here.add(sealed_digest(place))
            with suppress(AerialError):  # damaged; as a newer version would save it
                here.add(weights_of(load_policy(place)))
    flown = {name: result.provenance.get("policy_sha256") for name, result in run.judged.items()}
    return {name for name, weights in flown.items() if here and weights and weights not in here}


def footage(run: TrainingRun, videos: int, progress: bool = False, *, others: Collection[str] = ()) -> Footage:
    """Return films of the final policy: those of the run's evaluations but for ``others``, else of flights made now."""
    if not run.finished:
        return Footage(note="No films: the run is not finished.")
    for name, result in run.judged.items():
        if (
            name not in others
            and result.policy == str(run.path)
            and (kept := results.footage_of(run.path / name, result)).clips
        ):
            return kept
    return _flown(run, videos, progress) if videos else Footage()


def _flown(run: TrainingRun, videos: int, progress: bool) -> Footage:
    """Fly each of the policy's tasks and film it there."""
    from aerial_il.policies import load_policy

    try:
        policy = load_policy(run.path)
        flown = pilots.pilots_of(policy, str(run.path))
        folder = run.path / results.VIDEOS
        places = [folder / pilot.task for pilot in flown] if len(flown) > 1 else [folder]
        pairs = zip(flown, places, strict=True)
        films = [_filmed(pilot, policy.spec, place, videos, progress) for pilot, place in pairs]
    except AerialError as error:
        return Footage(note=f"No films: {error}")
    return Footage(tuple(clip for footage in films for clip in footage.clips), films[0].note)


def _filmed(pilot: pilots.Pilot, spec: EnvSpec, folder: Path, videos: int, progress: bool) -> Footage:
    """Film the first successes of a few flights, and failures of several kinds, ``videos`` of each."""
    from aerial_il.evaluation.rollouts import evaluate

    seeds = range(FILMED_SEED, FILMED_SEED + FLOWN)
    with closing(pilot.environment(spec.tier, num_envs=FLOWN, threads=0, controller=spec.controller)) as env:
        result = evaluate(env, pilot.policy, seeds, policy_name="the final policy", progress=progress)
        return film(env, result, folder, successes=videos, failures=videos, progress=progress)
