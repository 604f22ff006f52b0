"""One session in one environment: a tick takes a frame of the device and does what the session's state asks for.

No clock, no thread and no network here: what happens follows from the frames.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerial_il.core.contracts import BatchEnv, Policy, SeededPolicy, attach
from aerial_il.core.errors import (
    AerialError,
    InvalidValueError,
    NonFiniteActionError,
    SimulationDivergedError,
    StorageError,
)
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.teleop.input.frame import DeviceFrame
from aerial_il.teleop.input.mapping import Bindings
from aerial_il.teleop.piloting.arbiter import HAND_OVER_TICKS, Arbiter, Turn
from aerial_il.teleop.piloting.command import Command
from aerial_il.teleop.piloting.pilot import Pilot
from aerial_il.teleop.session.logbook import Logbook
from aerial_il.teleop.session.perturb import KINDS, Perturber, possible, refusal
from aerial_il.teleop.session.readings import readings_of
from aerial_il.teleop.session.reel import Reel
from aerial_il.teleop.session.session import FLYING, HOLDS_EPISODE, Event, State, after

log = logging.getLogger(__name__)

COUNTDOWN_TICKS = 100  # 2 s
ABANDONED_TICKS = 50  # with a dead man this long, a recording pauses by itself
SUCCESS_TICKS = 25  # success holds for half a second before it is believed


@dataclass(frozen=True)
class Status:
    """What a person is shown of a session after a tick."""

    state: str
    tick: int
    seed: int
    mode: str
    modes: tuple[str, ...]
    precise: bool
    dead: bool
    opening: float
    success: bool
    label: bool
    subtasks: Mapping[str, bool]
    lost: tuple[str, ...]  # sub-tasks whose loss nothing makes good in this flight
    held: float  # share of the time that success must hold for, until it is believed
    sim_time: float
    countdown: int
    steps: int
    speed: float
    input_seq: int
    message: str
    counts: Mapping[str, int]
    waiting: int
    time_scale: float
    flier: str  # policy, person, or nobody
    shared: bool  # there is a policy to take over from
    practice: bool  # nothing is kept
    marks: Mapping[str, float]  # sub-task -> share of the episode after which it was first solved
    person_steps: int  # of this episode's, those in which the person had taken over
    numbers: tuple[float, ...]


def by_hand(env: BatchEnv) -> BatchEnvironment:
    """Return ``env`` if it can be flown by hand.

    Raises:
        InvalidValueError: it is not the suite's, or has more than one world.
    """
    if not isinstance(env, BatchEnvironment):
        raise InvalidValueError(
            f"{env.spec.robot}:{env.spec.task} is not of this suite: only its tasks are flown by hand."
        )
    if env.num_envs != 1:
        raise InvalidValueError(f"num_envs is {env.num_envs}; a person flies one world.")
    return env


class Cockpit:
    """What a person flies and records.

    Args:
        env: an environment of one world. bindings: what the device's controls mean. logbook: where flights go.
        policy: what flies unless the person takes over; None if the person always does.
        time_scale: how fast time passes, for the record. countdown: ticks before an episode.
    """

    def __init__(
        self,
        env: BatchEnvironment,
        bindings: Bindings,
        logbook: Logbook,
        *,
        policy: Policy | None = None,
        time_scale: float = 1.0,
        countdown: int = COUNTDOWN_TICKS,
    ) -> None:
        self.env, self.bindings, self.logbook, self.time_scale = env, bindings, logbook, time_scale
        self.state, self.tick_count, self.message = State.IDLE, 0, "Fly freely. Nothing is kept until you record."
        self._countdown_ticks, self._countdown = countdown, 0
        self._held, self._success, self._label, self._steps, self.input_seq = 0, False, True, 0, 0
        self._lost: tuple[str, ...] = ()
        self._flags = np.zeros(len(env.spec.subtasks), bool)
        self._counts = logbook.counts()
        self._mode: str | None = None
        self._abandoned = self._person_steps = 0
        self.policy = None if policy is None else attach(policy, env)
        self.perturbations = possible(env)
        self.readings = readings_of(env.spec.observation)
        self.practice = False
        self._look: float | None = None
        self._reset()

    def tick(self, frame: DeviceFrame) -> None:
        """Do what this tick asks for: the person's events first, then a step of the flight where time passes."""
        self.tick_count += 1
        self.input_seq = frame.seq
        pressed = self.bindings.intent(frame).pressed
        try:
            self._take_events(pressed)
        except StorageError as error:
            self._start_over(error)
            return
        try:
            self._advance(frame, self._possible(pressed))
            if self.logbook.settle():
                self._counts = self.logbook.counts()
        except (SimulationDivergedError, NonFiniteActionError, StorageError) as error:
            self._start_over(error)

    def _take_events(self, pressed: frozenset[str]) -> None:
        for event in (Event.RECORD, Event.SAVE, Event.DISCARD, Event.PAUSE):
            if event.value in pressed:
                self.happen(event)
        if "undo" in pressed:
            self._undo()
        if "label" in pressed and self.state is State.REVIEW:
            self._label = not self._label

    def happen(self, event: Event) -> None:
        """Let an event have its effect."""
        before, self.state = self.state, after(self.state, event)
        if self.state is before:
            return
        if self.state is State.COUNTDOWN:
            self._countdown = self._countdown_ticks
            self._reset()
        elif self.state is State.RECORDING and before is State.COUNTDOWN:
            self._begin()
        elif self.state is State.REVIEW:
            self._review(event)
        elif self.state is State.SAVED:
            self._save()
        elif self.state is State.DISCARDED:
            self._discard()
        elif self.state is State.RESETTING:
            self._reset()
            self.state = after(self.state, Event.RESET)
        if self.state is State.PAUSED:
            self.message = "Nobody is at the controls: paused." if event is Event.LOST else "Paused."
        elif self.state is State.RECORDING:
            self.message, self._abandoned = "Recording.", 0
        elif self.state is State.COUNTDOWN:
            self.message = "Get ready."

    def leave(self) -> None:
        """Tell that nobody is at the controls any more: what is recorded pauses, and practice is over."""
        self.practise(on=False)
        self.happen(Event.LOST)

    def practise(self, *, on: bool) -> None:
        """Begin or end practice, in which nothing is kept; it begins between two episodes only."""
        if on == self.practice:
            return
        if on and self.state is not State.IDLE:
            self.message = "Finish this episode first: practice begins between two."
            return
        self.practice, self.state = on, State.IDLE
        self._reset()
        self.message = "Practice: nothing of it is kept." if on else "Practice is over: what you record now is kept."

    def rebind(self, bindings: Bindings) -> bool:
        """Give the controls other meanings, between two episodes only; return whether it was done."""
        if self.state is not State.IDLE:
            self.message = "Finish this episode first: keys change between two."
            return False
        self.bindings = bindings
        self._man()
        return True

    def look_back(self, share: float) -> None:
        """Show, while an episode is reviewed, the moment at a share of it in [0, 1]."""
        self._look = share

    @property
    def looked_at(self) -> np.ndarray | None:
        """State (S,) that is looked back at; None for the present one."""
        return None if self._look is None or self.state is not State.REVIEW else self._reel.at(self._look)

    @property
    def is_flying(self) -> bool:
        """Whether time passes."""
        return self.state in FLYING

    def status(self) -> Status:
        """Return what there is to show."""
        row, names = self._row(), self.env.spec.subtasks
        command = self._pilot.command if self.is_flying else Command()
        return Status(
            state=self.state.value,
            tick=self.tick_count,
            seed=self.logbook.seed,
            mode=self._pilot.mode,
            modes=self._pilot.modes,
            precise=self._pilot.precise,
            dead=self._pilot.dead,
            opening=round(self._pilot.opening, 3),
            success=self._success,
            label=self._label,
            subtasks=dict(zip(names, map(bool, self._flags), strict=True)),
            lost=self._lost,
            held=self._share_held(),
            sim_time=float(self.env.sim_time[0]),
            countdown=self._countdown,
            steps=self._steps,
            speed=round(float(np.linalg.norm(command.linear)), 3),
            input_seq=self.input_seq,
            message=self.message,
            counts=self._counts,
            waiting=self.logbook.waiting,
            time_scale=self.time_scale,
            flier=self._arbiter.flier.value,
            shared=self.policy is not None,
            practice=self.practice,
            marks={name: round(step / max(1, self._steps), 4) for name, step in self._marks.items()},
            person_steps=self._person_steps,
            numbers=tuple(number for reading in self.readings for number in reading.numbers(row)),
        )

    def close(self) -> None:
        """Keep what is finished, and leave an open episode for recovery."""
        self.logbook.close()

    def _possible(self, pressed: frozenset[str]) -> frozenset[str]:
        """Return what is pressed without disturbances that cannot happen here, which are refused."""
        impossible = pressed & set(KINDS) - set(self.perturbations)
        if impossible and self.is_flying:
            self.message = refusal(self.env, min(impossible))
        return pressed - impossible

    def _advance(self, frame: DeviceFrame, pressed: frozenset[str]) -> None:
        if self.state is State.COUNTDOWN:
            self._countdown -= 1
            if self._countdown <= 0:
                self.happen(Event.COUNTED)
        elif self.is_flying:
            self._fly(frame, pressed)

    def _fly(self, frame: DeviceFrame, pressed: frozenset[str]) -> None:
        recording = self.state is State.RECORDING
        turn = self._arbiter.act(frame, self._obs)
        self._mode = self._pilot.mode
        self._abandoned = self._abandoned + 1 if self._pilot.dead else 0
        if recording:
            self._reel.keep(self.env.get_state()[0])
        if kept := recording and not self.practice:
            self.logbook.observe(self._obs)
        met = self._perturber.step(pressed)
        self._disturbed += [f"{kind} at step {self._steps}" for kind in KINDS if kept and kind in pressed]
        result = self.env.step(met.meet(self.env, turn.action)[None])
        self._obs, self._flags = result.obs, result.info["subtasks"][0]
        if kept:
            self.logbook.act(frame, turn, met, result)
        if recording:
            self._note(turn)
        self._tell_losses()
        self._success = bool(result.info["success"][0])
        self._held = self._held + 1 if self._success else 0
        if result.terminated[0]:
            self._success = False
            self.happen(Event.ENDED)
        elif recording and self._held >= SUCCESS_TICKS:
            self.happen(Event.SUCCEEDED)
        elif recording and self._abandoned >= ABANDONED_TICKS:
            self.happen(Event.LOST)

    def _tell_losses(self) -> None:
        """Say of what was lost for good in this tick that the flight can no longer succeed."""
        flags = dict(zip(self.env.spec.subtasks, self._flags, strict=True))
        lost = tuple(name for name in self.env.scenario.task.once_lost if not flags[name])
        for name in set(lost) - set(self._lost):
            self.message = f"“{name.replace('_', ' ')}” is lost: this flight can no longer succeed. Discard it."
        self._lost = lost

    def _share_held(self) -> float:
        """Return the share in [0, 1], of the time for which success must hold until it is believed, it has held."""
        task_s, belief_s = self.env.scenario.task.dwell_s, SUCCESS_TICKS * self.env.spec.control_dt_s
        held_s = task_s * float(self.env.dwell[0]) + self.env.spec.control_dt_s * min(self._held, SUCCESS_TICKS)
        return round(held_s / (task_s + belief_s), 3)

    def _note(self, turn: Turn) -> None:
        """Count a step of the episode, and note which sub-tasks it was the first to solve."""
        self._steps += 1
        self._person_steps += turn.is_intervention
        for name in (name for name, met in zip(self.env.spec.subtasks, self._flags, strict=True) if met):
            self._marks.setdefault(name, self._steps)

    def _start_over(self, error: AerialError) -> None:
        """Begin anew after the disk or the physics has failed; an open episode stays for ``aerial-il recover``."""
        self.logbook.start_over()
        self.state = State.IDLE
        self._reset()
        self.message = f"Set back to the start: {error}"
        log.error("%s The flight was set back to its start; what was open is kept for aerial-il recover.", error)

    def _begin(self) -> None:
        self._man()
        if not self.practice:
            self.logbook.begin(self._settings())
        self._held = self._steps = self._person_steps = 0
        self._reel, self._marks, self._disturbed = Reel(), {}, []

    def _settings(self) -> dict[str, Any]:
        shared = {} if self.policy is None else {"hand_over_ticks": HAND_OVER_TICKS}
        return {"time_scale": self.time_scale, "success_ticks": SUCCESS_TICKS, **shared, **self._pilot.settings()}

    def _review(self, event: Event) -> None:
        self._label, self._look = self._success, None
        self._reel.keep(self.env.get_state()[0])
        self.message = {
            Event.SUCCEEDED: "Keep it?",
            Event.ENDED: "The flight is over: a crash, or an object out of reach. Keep it as a failure?",
        }.get(event, "Stopped. Keep it?" if self._success else "Stopped before success. Keep it as a failure?")

    def _save(self) -> None:
        success = self._success and self._label
        note = "the operator called it a failure" if self._success and not self._label else ""
        if self.practice or not self._steps:
            self._drop()
            return
        self.logbook.observe(self._obs)
        self.logbook.save(success=success, note="; ".join([*filter(None, [note]), *self._disturbed]))
        self._stored("Saved as a demonstration." if success else "Saved as a failure.")

    def _discard(self) -> None:
        if self.practice or not self._steps:
            self._drop()
            return
        self.logbook.observe(self._obs)
        self.logbook.discard(success=self._success and self._label)
        self._stored("Discarded: it lies in the trash, undo brings it back.")

    def _drop(self) -> None:
        self.logbook.forget()
        self._stored("Practice: nothing is kept." if self.practice else "Nothing was flown, nothing is kept.")

    def _stored(self, message: str) -> None:
        self.happen(Event.STORED)
        self.message = message

    def _undo(self) -> None:
        if self.state in HOLDS_EPISODE:
            self.message = "Finish this episode first: undo brings back a discarded one."
            return
        uid = self.logbook.undo()
        self.message = f"Brought back: {uid}" if uid else "There is nothing to bring back."
        self._counts = self.logbook.counts()

    def _row(self) -> dict[str, np.ndarray]:
        return {name: values[0] for name, values in self._obs.items()}

    def _reset(self) -> None:
        self._obs = self.env.reset(self.logbook.seed)
        self._flags = np.zeros(len(self.env.spec.subtasks), bool)
        self._success, self._held, self._steps, self._lost = False, 0, 0, ()
        self._reel, self._marks, self._disturbed = Reel(), dict[str, int](), list[str]()
        self._man()
        self._counts = self.logbook.counts()

    def _man(self) -> None:
        """Set new hands to the controls, and the policy to the beginning of its flight."""
        self._pilot = Pilot(self.env.spec, self.env.scenario.robot.vehicle, self.bindings, self._mode)
        self._arbiter = Arbiter(self._pilot, self.policy)
        self._arbiter.engage(self._obs)
        self._perturber = Perturber(self.env, self.logbook.seed)
        if isinstance(self.policy, SeededPolicy):
            self.policy.begin(self.env.seeds)
