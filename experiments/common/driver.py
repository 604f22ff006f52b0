"""Demonstrations by the model of a driver, for studies, in draws of other habits, errors and seeds."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import aerial_il
from aerial_il.algorithms.bc import BC
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.dataset import Dataset
from aerial_il.data.folder import DEMOS, DatasetFolder
from aerial_il.data.waypoints import LOOKAHEAD_S, Waypoints
from aerial_il.policies.parts.egocentric import egocentric
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.teleop.driver.operator import DriverOperator
from experiments.common.record import Record

FIRST_SEED, SEEDS_PER_DRAW = 2_000_000, 10_000  # far from other demonstrations, evaluations and interactive flights


@dataclass(frozen=True)
class Driven:
    """What the driver flies.

    Attributes:
        robot, task, tier: of the cell. draw: which of several independent ones.
    """

    robot: str
    task: str
    tier: str
    draw: int

    @property
    def label(self) -> str:
        return f"{self.robot}-{self.task}-{self.tier}/{self.draw}"

    def decided_by(self) -> dict[str, Any]:
        """Return all that decides the flights."""
        return asdict(self)

    def environment(self, num_envs: int) -> BatchEnvironment:
        """Return worlds of the cell."""
        return aerial_il.load_batch(self.robot, self.task, num_envs=num_envs, tier=self.tier, num_threads=1)

    def demonstrations(self, record: Record, count: int) -> Dataset:
        """Return the first ``count`` successes of the driver, flying those that are missing; failures cost a seed more.

        Raises:
            InvalidValueError: more than half of the flights fail.
        """
        path = record.place("driven", self.label, self.decided_by())
        env, first, flown = self.environment(1), FIRST_SEED + SEEDS_PER_DRAW * self.draw, count
        try:
            while len(DatasetFolder(path).files(DEMOS)) < count:
                if flown > 2 * count:
                    raise InvalidValueError(f"{path}: the driver fails too often to give {count} demonstrations.")
                driver = DriverOperator(seed=self.draw)
                driver.record(env, None, path, seeds=range(first, first + flown), tags={})
                flown += count - len(DatasetFolder(path).files(DEMOS))
        finally:
            env.close()
        dataset = aerial_il.open_dataset(str(path))
        return dataset.only(sorted(dataset.uids)[:count])


def suited[P: PolicySettings](algorithm: BC, policy: P) -> tuple[BC, P]:
    """Return settings as ``aerial-il train`` makes them by itself for what a person flew."""
    return replace(algorithm, waypoints=Waypoints(lookahead_s=LOOKAHEAD_S, flown_by="hand")), egocentric(policy)
