"""What is flown onboard is kept as it was flown: without what was never sent, and also when it is interrupted."""

from pathlib import Path
from typing import Any

import numpy as np

from aerial_il import open_dataset
from aerial_il.links.onboard import Flight, fly
from aerial_il.links.robot import SimulatedRobot
from aerial_il.links.simulated.in_process import SimulatedLink
from tests.links.test_fly import ROBOT, TASK, fresh_policy


class Silent(SimulatedLink):
    """A link over which nothing is heard in some readings."""

    readings = 0

    def read(self) -> Any:
        self.readings += 1
        shown = super().read()
        return None if 20 <= self.readings < 40 else shown


class Interrupted(SimulatedLink):
    """A link at which somebody presses Ctrl-C."""

    ticks = 0

    def step(self) -> None:
        self.ticks += 1
        if self.ticks == 30:
            raise KeyboardInterrupt
        super().step()


def flown(link: SimulatedLink, tmp_path: Path) -> tuple[Flight, list[Any]]:
    flight = fly(fresh_policy("mlp"), link, seconds=1.2, seed=3)
    flight.save(tmp_path / "flight.npz")
    return flight, [*open_dataset(str(tmp_path / "flight.npz"), failures=True)]


def test_what_was_never_sent_is_no_part_of_what_is_written(tmp_path: Path) -> None:
    flight, pieces = flown(Silent(SimulatedRobot(ROBOT, TASK)), tmp_path)
    held = flight.loop.held
    assert 0 < held < len(flight.actions)
    assert (~flight.sent).sum() == held
    assert len(pieces) == 2, "before it held, and after"
    np.testing.assert_array_equal(np.concatenate([piece.actions for piece in pieces]), flight.actions[flight.sent])


def test_an_interrupted_flight_is_kept(tmp_path: Path) -> None:
    flight, (piece,) = flown(Interrupted(SimulatedRobot(ROBOT, TASK)), tmp_path)
    assert flight.why == "interrupted"
    assert len(piece) == len(flight.actions) == len(flight.obs["ee_pos"]) - 1 == 29
    assert flight.sent.all()


def test_interrupted_at_once_nothing_was_flown() -> None:
    link = Interrupted(SimulatedRobot(ROBOT, TASK))
    link.ticks = 29
    flight = fly(fresh_policy("mlp"), link, seconds=1.0, seed=3)
    assert flight.actions.shape == (0, link.spec.action.size)
    assert flight.why == "interrupted"
