"""Flights to look at that are not on disk yet, and what a policy predicts along those that are."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.workflows.parts import pilots

if TYPE_CHECKING:
    from aerial_il.presentation.rerun.chunks import Chunks


def flown_now(source: str, tier: str, seed: int, like: Episode | None) -> Iterator[Episode]:
    """Yield the flight of a run's policy, or of the expert, in the cell and from the start of ``like`` if there is one.

    Args:
        source: folder of a run, or ``expert``. tier, seed: of the flight, where none is beside it.
    """
    if source == pilots.EXPERT and like is None:
        raise InvalidValueError("expert is shown beside another flight: aerial-il inspect runs/NAME expert")
    spec = like.spec if like is not None else None
    if spec is not None and spec.is_outside:
        raise InvalidValueError(
            f"{source} cannot be flown beside {spec.robot}/{spec.task}: that environment is not part of the suite."
        )
    cell = (spec.robot, spec.task, spec.action.level) if spec else (None, None, None)
    pilot = pilots.pilot(source, robot=cell[0], task=cell[1], action=cell[2])
    law = spec.controller if spec else pilots.DEFAULT_CONTROLLER
    env = pilot.environment(spec.tier if spec else tier, num_envs=1, threads=1, controller=law)
    try:
        with TemporaryDirectory() as folder:
            first = like.seed if like is not None else seed
            yield pilots.record(env, pilot.policy, first, Path(folder) / "flight.mcap", name=source)
    finally:
        env.close()


def predictor(source: str | None) -> Callable[[Episode], Chunks | None]:
    """Return what predicts actions along flights by the policy of a run; None of them without a run."""
    if source is None:
        return lambda episode: None
    from aerial_il.evaluation.predictions import predict
    from aerial_il.policies import load_policy
    from aerial_il.presentation.rerun.chunks import Chunks

    policy = load_policy(source)

    def chunks(episode: Episode) -> Chunks:
        found = predict(policy, episode)
        return Chunks(found.predicted, found.starts)

    return chunks
