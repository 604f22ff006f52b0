"""The model of a driver as the person whom an interactive algorithm learns from: no page, faster than real time."""

import os
from collections.abc import Mapping, Sequence
from typing import Any

from aerial_il.core.contracts import BatchEnv, Policy
from aerial_il.teleop.devices.driver import BINDINGS, Driver
from aerial_il.teleop.driver.watch import Judgement
from aerial_il.teleop.session.cockpit import Cockpit
from aerial_il.teleop.session.helm import by_hand
from aerial_il.teleop.session.logbook import Logbook
from aerial_il.teleop.session.session import State

LEARNER = "learner"


class DriverOperator:
    """Records flights of a learner, or its own.

    Args:
        seed: of its habits. judgement: when it takes over, and hands back.
    """

    def __init__(self, *, seed: int = 0, judgement: Judgement | None = None) -> None:
        self._seed, self._judgement = seed, judgement

    def notify(self, rounds: Sequence[object], message: str) -> None:
        pass

    def record(
        self,
        env: BatchEnv,
        learner: Policy | None,
        out: str | os.PathLike[str],
        *,
        seeds: range,
        tags: Mapping[str, Any],
    ) -> None:
        """Record flights until ``out`` holds one for each of ``seeds``: of ``learner``, or by hand if there is none."""
        settings = {**tags, "driver_seed": self._seed}
        name = None if learner is None else LEARNER
        world = by_hand(env)
        logbook = Logbook(world, str(out), operator="driver", first_seed=seeds.start, policy=name, settings=settings)
        cockpit = Cockpit(world, BINDINGS, logbook, policy=learner, countdown=1)
        driver = Driver(
            env.spec.task,
            cockpit.readings,
            dt=env.spec.control_dt_s,
            seed=self._seed,
            judgement=self._judgement,
        )
        try:
            while logbook.seed < seeds.stop or cockpit.state is not State.IDLE:
                driver.see(cockpit.status())
                cockpit.tick(driver.frame())
        finally:
            cockpit.close()
