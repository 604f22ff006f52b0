"""Whether starts that a policy is judged on are among those that it learned from."""

import logging
import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from aerial_il.core.errors import AerialError
from aerial_il.core.specs import EnvSpec
from aerial_il.data.dataset import open_dataset
from aerial_il.evaluation.training_run import TrainingRun
from aerial_il.workflows.parts.rollout_evaluator import JUDGING_SEED

log = logging.getLogger(__name__)


def warn_of_seen(run: TrainingRun, spec: EnvSpec, seeds: Collection[int]) -> None:
    """Say so where the datasets of a run, if they are still there, have flights of the seeds that it is judged on.

    Args:
        run: whose policy is judged. spec: of the environment. seeds: of the evaluation.
    """
    cell = f"{spec.robot}-{spec.task}".replace("/", "_")
    named = re.compile(rf"{re.escape(cell)}-.+-(\d{{6,}})-[0-9a-f]{{8}}")
    for path, count in _datasets(run.command):
        try:
            known = open_dataset(path, states=False).uids[:count]
        except AerialError:
            continue
        if shared := {int(found[1]) for uid in known if (found := named.fullmatch(uid))} & {*seeds}:
            log.warning(
                "%d of the %d seeds, the first %d, were flown in %s, which the policy learned from: this is no success "
                "on unseen starts. Choose others by seed=, and record demonstrations below seed %d.",
                len(shared), len(seeds), min(shared), path, JUDGING_SEED,
            )  # fmt: skip


def _datasets(command: Mapping[str, Any]) -> Iterator[tuple[str, int | None]]:
    """Yield the datasets of a training that are still there, and how many successes it took, or None for all."""
    said = command.get("dataset") or {}
    given = {said.get("path"): said.get("episodes"), **dict.fromkeys(said.get("others") or ())}
    for path, count in given.items():
        if path and Path(path).exists():
            yield path, count
