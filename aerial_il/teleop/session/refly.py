"""Fly the input log of a recording again, and require the same actions and states to the last bit."""

from pathlib import Path

import numpy as np

from aerial_il import robots
from aerial_il.core.contracts import Observation
from aerial_il.core.errors import DemoError
from aerial_il.data.episode import Episode
from aerial_il.data.replay import check_engine
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.teleop.devices.replay import Replay, frames_of
from aerial_il.teleop.input.mapping import Bindings
from aerial_il.teleop.piloting.arbiter import Arbiter
from aerial_il.teleop.piloting.pilot import PILOT, ManualPilot
from aerial_il.teleop.session.logbook import POLICY_ACTION
from aerial_il.teleop.session.perturb import TOPIC, Perturber


def refly(env: BatchEnvironment, episode: Episode, path: Path | str = "") -> int:
    """Give the frames of a recording to a new pilot and compare every action and state; return the number of steps.

    Args:
        env: an environment of one world like the one that was flown. episode: the recording. path: for errors.

    Raises:
        DemoError: nobody flew it by hand, another version of the pilot did, or the first step that differs.
    """
    place = str(path or episode.uid)
    check_engine(env.engine, episode, place)
    frames, settings = frames_of(episode, place), episode.provenance["settings"]
    _check_pilot(settings.get("pilot", 1), place)
    bindings = Bindings.from_dict(settings["bindings"])
    obs, device = env.reset(episode.seed), Replay(frames)
    pilot = ManualPilot(env.spec, robots.get(env.spec.robot).vehicle, bindings, settings["mode"])
    logged = Logged(episode.extras[POLICY_ACTION]) if POLICY_ACTION in episode.extras else None
    arbiter = Arbiter(pilot, logged, hand_over_ticks=settings.get("hand_over_ticks", 1))
    arbiter.engage(obs)
    perturber = Perturber(env, episode.seed)
    for step in range(len(frames)):
        _compare(place, step, "state", env.get_state()[0], episode.states[step])
        frame = device.frame()
        turn = arbiter.act(frame, obs)
        _compare(place, step, "action", turn.action, episode.actions[step])
        _compare(place, step, "expert_action", turn.label, episode.expert_actions[step])
        _compare(place, step, "is_intervention", np.atleast_1d(turn.is_intervention), episode.is_intervention[[step]])
        met = perturber.step(bindings.intent(frame).pressed)
        if TOPIC in episode.extras:
            _compare(place, step, TOPIC, met.to_row(), episode.extras[TOPIC][step])
        obs = env.step(met.meet(env, turn.action)[None]).obs
    _compare(place, len(frames), "state", env.get_state()[0], episode.states[-1])
    return len(frames)


class Logged:
    """The policy's own actions (T, Da) of a recording, given again: no network is needed, on any machine."""

    def __init__(self, actions: np.ndarray) -> None:
        self._actions = iter(actions)

    def act(self, obs: Observation) -> np.ndarray:
        return next(self._actions)[None]

    def reset(self, mask: np.ndarray | None = None) -> None:
        pass


def _check_pilot(flown: int, path: str) -> None:
    if flown != PILOT:
        hint = "Its frames mean something else now. `aerial-il replay` still flies its actions again."
        raise DemoError(path, "was flown by another version of the pilot.", expected=PILOT, got=flown, hint=hint)


def _compare(path: str, step: int, field: str, got: np.ndarray, recorded: np.ndarray) -> None:
    wrong = np.flatnonzero((got != recorded) & ~(np.isnan(got) & np.isnan(recorded)))
    if wrong.size:
        i = int(wrong[0])
        raise DemoError(
            path, "is not what its input log flies.", topic="/device", step=step, field=f"{field}[{i}]",
            expected=repr(recorded[i]), got=repr(got[i]),
        )  # fmt: skip
