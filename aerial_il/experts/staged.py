"""An expert made of others, one for each stage of a long task."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from aerial_il.core.contracts import BatchEnv
from aerial_il.experts.expert import Expert, HasSimulation


class StagedExpert(Expert):
    """Fly each world as the expert of the stage that it is in.

    Attributes:
        stages: name -> expert. phase_names: those of the stages, each behind the stage's name.
        parts: the experts themselves, in that order.
    """

    stages: ClassVar[Mapping[str, type[Expert]]]

    def __init_subclass__(cls) -> None:
        cls.phase_names = tuple(f"{name}_{phase}" for name, part in cls.stages.items() for phase in part.phase_names)

    def __init__(self, *, noise: float = 0.0, seed: int = 0, look: bool = False) -> None:
        super().__init__(noise=noise, seed=seed, look=look)
        self.parts = tuple(part() for part in self.stages.values())
        self._first = np.cumsum([0, *(len(part.phase_names) for part in self.parts)])

    def attach(self, env: BatchEnv | HasSimulation) -> None:
        super().attach(env)
        for part in self.parts:
            part.attach(env)

    @abstractmethod
    def stage(self, now: np.ndarray) -> np.ndarray:
        """(n,) number of the stage to be in, read off the state; ``now``: the one until now, -1 at the start."""

    def first_phase(self) -> np.ndarray:
        return self._entered(self.stage(np.full(self.view.n, -1)))

    def next_phase(self) -> np.ndarray:
        now = self._share()
        due = self.stage(now)
        moved = np.stack([part.next_phase() for part in self.parts])[now, np.arange(now.size)] + self._first[now]
        return np.where(due != now, self._entered(due), moved)

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        now = self._share()
        rows = np.arange(now.size)
        position, rot6d, gripper = (
            np.stack(each)[now, rows] for each in zip(*(p.command() for p in self.parts), strict=True)
        )
        return position, rot6d, gripper

    def noise_share(self) -> np.ndarray:
        now = self._share()
        return np.stack([part.noise_share() for part in self.parts])[now, np.arange(now.size)]

    def _entered(self, stage: np.ndarray) -> np.ndarray:
        """(n,) phases with which stages begin."""
        return np.stack([part.first_phase() for part in self.parts])[stage, np.arange(stage.size)] + self._first[stage]

    def _share(self) -> np.ndarray:
        """Tell every part its phase, the first one where it is not its stage; return the stages (n,)."""
        now = np.searchsorted(self._first, self.phase, side="right") - 1
        for k, part in enumerate(self.parts):
            part.phase, part.timer = np.where(now == k, self.phase - self._first[k], 0), self.timer
        return now
