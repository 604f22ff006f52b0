"""One session in one environment: a tick takes a frame of the device and does what the session's state asks for.

No clock, no thread and no network here: what happens follows from the frames.
"""

import logging
from typing import Any

import numpy as np

from aerial_il.core.contracts import Observation, Policy
from aerial_il.core.errors import (
    AerialError,
    DemoError,
    NonFiniteActionError,
    SimulationDivergedError,
    StorageError,
)
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.teleop.input.frame import DeviceFrame
from aerial_il.teleop.input.mapping import Bindings
from aerial_il.teleop.piloting.arbiter import HAND_OVER_TICKS, first_row
from aerial_il.teleop.piloting.command import Command
from aerial_il.teleop.session.attempt import SUCCESS_TICKS, Attempt
from aerial_il.teleop.session.helm import Helm
from aerial_il.teleop.session.logbook import Logbook
from aerial_il.teleop.session.perturb import KINDS, possible, refusal
from aerial_il.teleop.session.readings import readings_of
from aerial_il.teleop.session.session import FLYING, HOLDS_EPISODE, Event, State, after
from aerial_il.teleop.session.status import Status

log = logging.getLogger(__name__)

COUNTDOWN_TICKS = 100  # 2 s
ABANDONED_TICKS = 50  # with a dead man this long, a recording pauses by itself
QUESTIONS = {  # at the end of a recording
    Event.SUCCEEDED: "Keep it?",
    Event.ENDED: "The flight is over: a crash, or an object out of reach. Keep it as a failure?",
}


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
        self.env, self.logbook, self.time_scale = env, logbook, time_scale
        self.state, self.message = State.IDLE, "Fly freely. Nothing is kept until you record."
        self.tick_count = self.input_seq = self._countdown = 0
        self._countdown_ticks = countdown
        self._possible, self.readings = frozenset(possible(env)), readings_of(env.spec.observation)
        self.practice = False
        self._look: float | None = None
        self._helm = Helm(env, bindings, policy, logbook.seed)
        self._attempt, self._counts = Attempt(env), logbook.counts()

    @property
    def bindings(self) -> Bindings:
        """What the device's controls mean."""
        return self._helm.bindings

    @property
    def obs(self) -> Observation:
        """What the world shows after the last tick, ``name -> (1, D)``."""
        return self._helm.obs

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
            self._advance(frame, pressed)
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
            self._attempt.label = not self._attempt.label

    def happen(self, event: Event) -> None:
        """Let an event have its effect."""
        before, self.state = self.state, after(self.state, event)
        if self.state is before:
            return
        match self.state:
            case State.COUNTDOWN:
                self._countdown = self._countdown_ticks
                self._reset()
                self.message = "Get ready."
            case State.RECORDING:
                if before is State.COUNTDOWN:
                    self._begin()
                self.message, self._helm.absent_ticks = "Recording.", 0
            case State.PAUSED:
                self.message = "Nobody is at the controls: paused." if event is Event.LOST else "Paused."
            case State.REVIEW:
                self._review(event)
            case State.SAVED | State.DISCARDED:
                self._decide(keep=self.state is State.SAVED)
            case State.RESETTING:
                self._reset()
                self.state = after(self.state, Event.RESET)

    def leave(self) -> None:
        """Say that nobody is at the controls any more: what is recorded pauses, and practice is over."""
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
        self._helm.bindings = bindings
        self._helm.man(self.logbook.seed)
        return True

    def look_back(self, share: float) -> None:
        """Show, while an episode is reviewed, the moment at a share of it in [0, 1]."""
        self._look = share

    @property
    def looked_at(self) -> np.ndarray | None:
        """State (S,) that is looked back at; None for the present one."""
        return None if self._look is None or self.state is not State.REVIEW else self._attempt.reel.at(self._look)

    @property
    def is_flying(self) -> bool:
        """Whether time passes."""
        return self.state in FLYING

    def status(self) -> Status:
        """Return what there is to show."""
        row, attempt, pilot = first_row(self._helm.obs), self._attempt, self._helm.pilot
        command = pilot.command if self.is_flying else Command()
        return Status(
            state=self.state.value,
            tick=self.tick_count,
            seed=self.logbook.seed,
            mode=pilot.mode,
            modes=pilot.modes,
            precise=pilot.precise,
            dead=pilot.dead,
            opening=round(pilot.opening, 3),
            success=attempt.success,
            label=attempt.label,
            subtasks=attempt.subtasks,
            lost=attempt.lost,
            held=attempt.share_held(),
            sim_time=float(self.env.sim_time[0]),
            countdown=self._countdown,
            steps=attempt.steps,
            speed=round(float(np.linalg.norm(command.linear)), 3),
            input_seq=self.input_seq,
            message=self.message,
            counts=self._counts,
            waiting=self.logbook.waiting,
            time_scale=self.time_scale,
            flier=self._helm.arbiter.flier.value,
            shared=self._helm.policy is not None,
            practice=self.practice,
            marks=attempt.shares(),
            person_steps=attempt.person_steps,
            numbers=tuple(number for reading in self.readings for number in reading.numbers(row)),
        )

    def close(self) -> None:
        """Keep what is finished, and leave an open episode for recovery."""
        self.logbook.close()

    def _advance(self, frame: DeviceFrame, pressed: frozenset[str]) -> None:
        if self.state is State.COUNTDOWN:
            self._countdown -= 1
            if self._countdown <= 0:
                self.happen(Event.COUNTED)
        elif self.is_flying:
            if impossible := pressed & set(KINDS) - self._possible:
                self.message = refusal(self.env, min(impossible))
            self._fly(frame, pressed - impossible)

    def _fly(self, frame: DeviceFrame, pressed: frozenset[str]) -> None:
        recording, attempt = self.state is State.RECORDING, self._attempt
        kept = recording and not self.practice
        turn = self._helm.act(frame)
        if recording:
            attempt.reel.keep(self.env.get_state()[0])
        if kept:
            self.logbook.observe(self._helm.obs)
            attempt.disturbed += [f"{kind} at step {attempt.steps}" for kind in KINDS if kind in pressed]
        met, result = self._helm.step(turn, pressed)
        if kept:
            self.logbook.act(frame, turn, met, result)
        for name in attempt.see(result):
            self.message = f"“{name.replace('_', ' ')}” is lost: this flight can no longer succeed. Discard it."
        if recording:
            attempt.count(turn)
        if result.terminated[0]:
            self.happen(Event.ENDED)
        elif recording and attempt.is_believed:
            self.happen(Event.SUCCEEDED)
        elif recording and self._helm.absent_ticks >= ABANDONED_TICKS:
            self.happen(Event.LOST)

    def _start_over(self, error: AerialError) -> None:
        """Begin anew after the disk or the physics has failed; an open episode stays for ``aerial-il recover``."""
        self.logbook.start_over()
        self.state = State.IDLE
        self._reset()
        self.message = f"Set back to the start: {error}"
        log.error("%s The flight was set back to its start; what was open is kept for aerial-il recover.", error)

    def _begin(self) -> None:
        self._helm.man(self.logbook.seed)
        if not self.practice:
            self.logbook.begin(self._settings())

    def _settings(self) -> dict[str, Any]:
        shared = {} if self._helm.policy is None else {"hand_over_ticks": HAND_OVER_TICKS}
        return {"time_scale": self.time_scale, "success_ticks": SUCCESS_TICKS, **shared, **self._helm.pilot.settings()}

    def _review(self, event: Event) -> None:
        self._attempt.label, self._look = self._attempt.success, None
        self._attempt.reel.keep(self.env.get_state()[0])
        stopped = "Stopped. Keep it?" if self._attempt.success else "Stopped before success. Keep it as a failure?"
        self.message = QUESTIONS.get(event, stopped)

    def _decide(self, *, keep: bool) -> None:
        """Put what was flown where it belongs: to the others, into the trash, or nowhere."""
        attempt = self._attempt
        success = attempt.success and attempt.label
        if self.practice or not attempt.steps:
            self.logbook.forget()
            message = "Practice: nothing is kept." if self.practice else "Nothing was flown, nothing is kept."
        elif keep:
            called = ["the operator called it a failure"] if attempt.success and not attempt.label else []
            self.logbook.observe(self._helm.obs)
            self.logbook.save(success=success, note="; ".join([*called, *attempt.disturbed]))
            message = "Saved as a demonstration." if success else "Saved as a failure."
        else:
            self.logbook.observe(self._helm.obs)
            self.logbook.discard(success=success)
            message = "Discarded: it lies in the trash, undo brings it back."
        self.happen(Event.STORED)
        self.message = message

    def _undo(self) -> None:
        if self.state in HOLDS_EPISODE:
            self.message = "Finish this episode first: undo brings back a discarded one."
            return
        try:
            uid = self.logbook.undo()
            self.message = f"Brought back: {uid}" if uid else "There is nothing to bring back."
        except DemoError as error:
            self.message = f"It cannot be brought back: {error}"
        self._counts = self.logbook.counts()

    def _reset(self) -> None:
        self._helm.reset(self.logbook.seed)
        self._attempt, self._counts = Attempt(self.env), self.logbook.counts()
