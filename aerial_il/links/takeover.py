"""A person on the page who watches a policy fly a robot, and takes over; while nobody watches, the robot hovers."""

import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, Self

import numpy as np

from aerial_il.core.contracts import BatchEnv, Observation
from aerial_il.core.errors import InvalidValueError
from aerial_il.links.environment import LinkedEnvironment
from aerial_il.links.pilot import LinkPilot
from aerial_il.teleop.flight import CAMERAS, Site, about
from aerial_il.teleop.input.frame import DeviceFrame
from aerial_il.teleop.input.mapping import Bindings
from aerial_il.teleop.piloting.arbiter import Arbiter, Flier, Turn, first_row
from aerial_il.teleop.piloting.command import Command
from aerial_il.teleop.piloting.pilot import ManualPilot
from aerial_il.teleop.session.clock import Pace
from aerial_il.teleop.session.readings import readings_of
from aerial_il.teleop.session.status import Status
from aerial_il.teleop.web.host import PageHost
from aerial_il.teleop.web.server import Server

WATCH_S = 0.1


class TakeOver:
    """Flies a :class:`LinkPilot`, or by the person's hands while they hold take-over.

    Args:
        pilot: what flies otherwise. env: the robot, in its own time. bindings: of the page's devices.
        site: where the page is served. operator: who watches. opened: called when the page is there.

    Attributes:
        by_person: seed -> ticks that the person flew, where they did.

    Raises:
        InvalidValueError: the robot's time waits for the policy, so that a person could not keep up with it.
    """

    def __init__(
        self,
        pilot: LinkPilot,
        env: LinkedEnvironment,
        bindings: Bindings,
        site: Site,
        *,
        operator: str,
        opened: Callable[[Server], object],
    ) -> None:
        if env.loop.link.lockstep:
            raise InvalidValueError("page=true is for a robot in its own time: add link.clock=wall.")
        self._pilot, self._env, self._bindings = pilot, env, bindings
        texts = {**about(env, bindings, operator, site), "perturbations": []}  # pyright: ignore[reportArgumentType]
        place = {"host": site.host, "port": site.port, "tls": site.tls}
        self._page = PageHost(env.model, bindings, texts, cameras=CAMERAS, size=site.size, opened=opened, **place)
        self._readings = readings_of(env.spec.observation)
        self._ticks, self.by_person, self._alone = 0, Counter[int](), Counter[int]()
        self._turn: Turn | None = None
        self._arbiter, self._engage = self._engaged(), True

    def __enter__(self) -> Self:
        self._page.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._page.__exit__()

    @property
    def server(self) -> Server:
        """Of the page."""
        return self._page.server

    @property
    def is_intervention(self) -> np.ndarray:
        """(1,) bool, whether the person flew the last action."""
        return np.array([self._turn is not None and self._turn.is_intervention])

    @property
    def expert_action(self) -> np.ndarray:
        """(1, Da) what the person meant where they took over, else NaN."""
        empty = np.full(self._env.spec.action.size, np.nan)
        return (empty if self._turn is None else self._turn.label)[None]

    def wait(self) -> None:
        """Wait until somebody has opened the page: whoever is to take over is there when the robot begins to fly."""
        while not len(self.server.visitors):
            time.sleep(WATCH_S)

    def attach(self, env: BatchEnv) -> None:
        self._pilot.attach(env)

    def begin(self, seeds: np.ndarray, mask: np.ndarray | None = None) -> None:
        self._pilot.begin(seeds, mask)
        for ticks in (self.by_person, self._alone):
            del ticks[self._env.loop.seed]
        self._engage = True

    def reset(self, mask: np.ndarray | None = None) -> None:
        self._pilot.reset(mask)

    def act(self, obs: Observation) -> np.ndarray:
        """Return the action (1, Da) of who flies; the robot hovers while something is wrong with it."""
        loop, frame = self._env.loop, self._page.inbox.frame()
        action = self._unflown(obs) if loop.trouble else self._shared(frame, obs)
        self._ticks += 1
        self._page.film.show(self._env.get_state()[0], frame.seq)
        self._page.server.report(self._status(obs, frame.seq), loop.pace or Pace(0.0, 1.0, 0, 0))
        return action

    def made_of(self, world: int) -> Mapping[str, Any]:
        return {**self._pilot.made_of(world), "person_ticks": self.by_person[self._env.loop.seed]}

    def objection(self, world: int) -> str:
        alone = self._alone[self._env.loop.seed]
        unwatched = f"nobody was on the page for {alone} ticks, in which the robot hovered" if alone else ""
        return self._pilot.objection(world) or unwatched

    def close(self) -> None:
        self._pilot.close()

    def _unflown(self, obs: Observation) -> np.ndarray:
        self._turn, self._engage = None, True
        return self._pilot.act(obs)

    def _shared(self, frame: DeviceFrame, obs: Observation) -> np.ndarray:
        if self._engage:
            self._arbiter, self._engage = self._engaged(), False
            self._arbiter.engage(obs)
            self._arbiter.pilot.engage(first_row(obs), self._env.loop.sent)
        self._turn = turn = self._arbiter.act(frame, obs)
        self.by_person.update([self._env.loop.seed] if turn.flier is Flier.PERSON else [])
        self._alone.update([self._env.loop.seed] if turn.flier is Flier.NOBODY else [])
        return turn.action[None]

    def _engaged(self) -> Arbiter:
        hands = ManualPilot(self._env.spec, self._env.scenario.robot.vehicle, self._bindings)
        return Arbiter(hands, self._pilot)

    def _status(self, obs: Observation, seq: int) -> Status:
        """Return what the person is shown."""
        env, hands, row = self._env, self._arbiter.pilot, first_row(obs)
        command = hands.command or Command()
        told = env.loop.told
        return Status(
            state="recording",
            tick=self._ticks,
            seed=int(env.seeds[0]),
            mode=hands.mode,
            modes=hands.modes,
            precise=hands.precise,
            dead=hands.dead,
            opening=round(hands.opening, 3),
            success=bool(told.get("success", False)),
            label=True,
            subtasks=dict(zip(env.spec.subtasks, map(bool, told.get("subtasks", ())), strict=False)),
            lost=(),
            held=0.0,
            sim_time=float(env.sim_time[0]),
            countdown=0,
            steps=round(float(env.sim_time[0]) / env.spec.control_dt_s),
            speed=round(float(np.linalg.norm(command.linear)), 3),
            input_seq=seq,
            message=self._env.loop.trouble or "The policy flies. Hold take-over to fly yourself.",
            counts={},
            waiting=0,
            time_scale=1.0,
            flier=self._arbiter.flier.value,
            shared=True,
            practice=False,
            marks={},
            person_steps=self.by_person[self._env.loop.seed],
            numbers=tuple(number for reading in self._readings for number in reading.numbers(row)),
        )
