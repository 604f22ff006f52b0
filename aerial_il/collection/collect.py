"""Fly an expert or a policy over seeds and keep every flight on disk, through kills, full disks and restarts."""

import logging
import os
import time
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from concurrent import futures
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

import numpy as np

from aerial_il.core.contracts import (
    BatchEnv,
    Observation,
    Policy,
    StepResult,
    attach,
    begin_episodes,
    intervention_of,
    label_of,
    made_of,
    objection_of,
    phase_names_of,
    phase_of,
)
from aerial_il.core.errors import AerialError, InvalidValueError, SimulationDivergedError, StorageError
from aerial_il.core.progress import Progress
from aerial_il.core.provenance import provenance
from aerial_il.data.folder import DEMOS, FAILURES, DatasetFolder
from aerial_il.data.mixture import check_unmixed
from aerial_il.data.provenance import DROPPED, Origin
from aerial_il.data.recording.recorder import Recorded, Recorder
from aerial_il.data.recording.writer import BusyError, EpisodeWriter
from aerial_il.data.table import failure_of

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Flown:
    """One recorded flight: seed, control steps, why and in which of the expert's phases it ended, sum of its rewards.

    ``failure`` is empty for a success, ``phase`` where there is none.
    """

    seed: int
    steps: int
    failure: str
    phase: str
    total_reward: float


@dataclass
class Collection:
    """What a collection brought home.

    Attributes:
        folder: the dataset folder.
        demos, failures: seeds of the episodes flown now, by outcome.
        skipped: seeds that were recorded already.
        busy: seeds that another process was recording.
        flights: uid -> each of the episodes flown now. provenance: of one of them.
        steps: control steps flown now.
        seconds: wall time.
    """

    folder: DatasetFolder
    demos: list[int] = field(default_factory=list)
    failures: list[int] = field(default_factory=list)
    skipped: list[int] = field(default_factory=list)
    busy: list[int] = field(default_factory=list)
    flights: dict[str, Flown] = field(default_factory=dict, repr=False)
    provenance: Mapping[str, Any] = field(default_factory=dict, repr=False)
    steps: int = 0
    seconds: float = 0.0

    def summary(self) -> str:
        """Return one line for people."""
        flown = len(self.demos) + len(self.failures)
        text = f"{flown} flown in {self.seconds:.1f} s: {len(self.demos)} demonstrations, {len(self.failures)} failures"
        text += f"; {len(self.skipped)} recorded before" if self.skipped else ""
        return text + (f"; {len(self.busy)} left to another process" if self.busy else "")

    def show(self, bar: Progress) -> None:
        """Move a progress bar, which counts seeds, to what has been done."""
        done = sum(map(len, (self.demos, self.failures, self.skipped, self.busy)))
        bar.set_postfix_str(f"success {len(self.demos)}, failure {len(self.failures)}", refresh=False)
        bar.update(done - bar.n)


def collect(
    env: BatchEnv,
    policy: Policy,
    seeds: Iterable[int],
    out: str | os.PathLike[str],
    *,
    policy_name: str = "expert",
    settings: Mapping[str, Any] | None = None,
    expert: Policy | None = None,
    longest: int | None = None,
    mix: bool = False,
    progress: bool = True,
    called: str = "collect",
) -> Collection:
    """Record one episode for each seed that ``out`` does not hold yet.

    Each world flies until its first success (unless ``env.ends_at_success`` is False), a crash, the loss of its object
    or the time limit. Successes go to ``demos/``, all others, labelled so, to ``failures/``; where the object was lost,
    the outcome has the note ``dropped``, and where the policy objects to a success, what it says. Files are equal byte
    for byte whatever the number of worlds, processes and restarts, as long as the policy treats each row of a batch
    alike.

    Other threads write while the worlds fly; a world gets its next seed when the file of its last one has its name. So
    a kill at any moment costs each world at most one episode: no finished file is lost, and what was being flown or
    written stays as a ``.part`` file and is flown anew, identically, when the same call is made again.

    Args:
        env: a batch environment; it records the cameras it was loaded with.
        policy: what flies. Where it has ``phase``, ``expert_action`` and ``is_intervention`` they are recorded.
        seeds: distinct episode seeds.
        out: the dataset folder; several processes may share it.
        policy_name: who flies, for the provenance; part of what makes two episodes the same.
        settings: plain values that change the flight, e.g. the expert's noise; likewise.
        expert: labels each observation with what it would do, while ``policy`` flies.
        longest: control steps after which a flight that has not ended is cut off; None leaves it the task's limit.
        mix: whether flights of another tier, flight law, pilot or with other settings may join those of ``out``.
        progress: show a progress bar, and in the end a summary. called: what the bar is called.

    Raises:
        SimulationDivergedError: the policy or the physics gave NaN or infinity; names seed and step.
        StorageError: the disk is full or the folder not writable; finished episodes are intact.
        InvalidValueError: seeds repeat, or ``out`` holds episodes of another environment, or, without ``mix``, some
            that were made otherwise.
    """
    seeds = _checked(seeds)
    folder = DatasetFolder(out)
    folder.claim(env.spec)
    collector = _Collector(env, policy, expert, folder, policy_name, dict(settings or {}), longest)
    if not mix:
        check_unmixed(folder, collector.origin.uid(seeds[0]), collector.provenance_of(seeds[0]))
    folder.keep_model(env.model_xml)
    collector.result.provenance = collector.provenance_of(seeds[0])
    with (
        _accounted(collector, seeds, progress),
        Progress(total=len(seeds), desc=called, unit="ep", disable=not progress) as bar,
    ):
        for _ in collector.fly(seeds):
            collector.result.show(bar)
    return collector.result


class _Collector:
    """n worlds, each with the seed it flies, fed from a queue of seeds."""

    def __init__(
        self,
        env: BatchEnv,
        policy: Policy,
        expert: Policy | None,
        folder: DatasetFolder,
        name: str,
        settings: dict[str, Any],
        longest: int | None,
    ) -> None:
        self.env, self.policy, self.expert, self.folder = env, policy, expert, folder
        self._longest = longest or np.iinfo(np.int64).max
        self._policies = [each for each in (policy, expert) if each is not None]
        self.result = Collection(folder)
        self.recorder = Recorder(env.spec, env.ctrl.shape[1], env.num_envs)
        self.written: dict[str, str] = {}  # uid -> SHA-256
        self.origin = Origin(
            env.spec,
            name,
            settings,
            env.model_xml,
            phases=phase_names_of(policy),
            engine=env.engine,
        )
        self._landed: dict[int, tuple[Flown, Future[Recorded]]] = {}  # world -> its flight, and its file to be
        self._uids = [""] * env.num_envs
        self._seeds = np.zeros(env.num_envs, np.int64)
        self._steps = np.zeros(env.num_envs, np.int64)
        self._returns = np.zeros(env.num_envs)

    def provenance_of(self, seed: int) -> dict[str, Any]:
        """Return where the episode of ``seed`` comes from."""
        return self.origin.provenance(seed, self.env.drawn(seed))

    def fly(self, seeds: Iterable[int]) -> Iterator[None]:
        """Fly all ``seeds``; yield whenever the result has changed."""
        waiting = deque(seeds)
        for each in self._policies:
            attach(each, self.env)
        obs, free = None, np.ones(self.env.num_envs, bool)
        while free.any():
            fresh = self._launch(waiting, free)
            yield
            if fresh.any():
                obs = self._reset(fresh if obs is not None else None)
            obs, free = self._fly_on(obs)

    def _fly_on(self, obs: Observation | None) -> tuple[Observation | None, np.ndarray]:
        """Fly until files are written; return what is seen, and the worlds (n,) that wrote them: none at the end."""
        while (flying := self.recorder.recording.copy()).any():
            assert obs is not None
            result = self._step(obs, flying)
            obs = result.obs
            won = result.info["success"] & self.env.ends_at_success
            ended = flying & (won | result.terminated | self._cut_off(result.truncated))
            if ended.any():
                self._land(ended, result)
            if (free := self.settle()).any():
                return obs, free
        return obs, self.settle(wait=True)

    def _launch(self, waiting: deque[int], free: np.ndarray) -> np.ndarray:
        """Give each free world the next seed that is not recorded yet; return the worlds (n,) that got one."""
        launched = np.zeros_like(free)
        for world in np.flatnonzero(free):
            while waiting and not launched[world]:
                seed = waiting.popleft()
                uid = self.origin.uid(seed)
                if writer := self._open(uid, seed):
                    self.recorder.begin(int(world), writer)
                    self._uids[world], self._seeds[world], self._steps[world] = uid, seed, 0
                    self._returns[world] = 0.0
                    launched[world] = True
        return launched

    def _open(self, uid: str, seed: int) -> EpisodeWriter | None:
        if self.folder.find(uid):
            self.result.skipped.append(seed)
            return None
        origin = self.provenance_of(seed)
        try:
            return EpisodeWriter(
                self.folder.file(uid),
                self.recorder.layout,
                uid=uid,
                provenance=origin,
                model_xml=self.origin.model_xml,
            )
        except BusyError:
            self.result.busy.append(seed)
            return None

    def _reset(self, worlds: np.ndarray | None) -> Observation:
        """Begin the episodes of ``worlds`` (n,), or of all, and return what all worlds show."""
        obs = self.env.reset(self._seeds, worlds)
        for each in self._policies:
            begin_episodes(each, self._seeds, worlds)
        return obs

    def _step(self, obs: Observation, flying: np.ndarray) -> StepResult:
        """Record what is seen, act, and record what comes of it."""
        self.recorder.observe(obs, state=self.env.get_state(), sim_time=self.env.sim_time)
        actions = self._act(obs, flying)
        labels = self._labels(obs, actions)
        result = self.env.step(actions, flying)
        self._steps[flying] += 1
        self._returns[flying] += result.reward[flying]
        count = self.env.num_envs
        self.recorder.act(
            action=actions,
            executed_action=result.info["executed_action"],
            expert_action=labels,
            is_intervention=intervention_of(self.policy, count),
            phase=phase_of(self.policy, count),
            ctrl=self.env.ctrl,
            reward=result.reward,
            terminated=result.terminated,
            truncated=self._cut_off(result.truncated),
        )
        self.result.steps += int(flying.sum())
        return result

    def _cut_off(self, truncated: np.ndarray) -> np.ndarray:
        """(n,) bool: the task's time is up, or that of the flight."""
        return truncated | (self._steps >= self._longest)

    def _act(self, obs: Observation, flying: np.ndarray) -> np.ndarray:
        actions = np.asarray(self.policy.act(obs), float)
        broken = flying & ~np.isfinite(actions).all(axis=1)
        if broken.any():
            world = int(np.argmax(broken))
            what = f"An action of {self.origin.policy!r} became non-finite"
            raise SimulationDivergedError(what, seed=int(self._seeds[world]), step=int(self._steps[world]))
        return self.env.spec.action.clip(actions)

    def _labels(self, obs: Observation, actions: np.ndarray) -> np.ndarray:
        """Return what the expert would do (n, Da): asked, or given by the policy that is one, or NaN."""
        if self.expert is not None:
            return np.asarray(self.expert.act(obs), float)
        return label_of(self.policy, np.full_like(actions, np.nan))

    def _land(self, ended: np.ndarray, result: StepResult) -> None:
        """Finish the episodes of the worlds in ``ended`` (n,)."""
        self.recorder.observe(result.obs, state=self.env.get_state(), sim_time=self.env.sim_time)
        crash = result.info.get("crash", result.terminated)
        dropped = result.info.get("dropped", np.zeros(self.env.num_envs, bool))
        phases, late = phase_of(self.policy, self.env.num_envs), self._cut_off(result.truncated)
        for world in np.flatnonzero(ended).tolist():
            won = bool(result.info["success"][world] and not crash[world])
            objection = objection_of(self.policy, world)
            success = won and not objection
            path = self.folder.file(self._uids[world], DEMOS if success else FAILURES)
            cut = str(result.info["ended"][world]) if "ended" in result.info and not won else ""
            note = DROPPED if dropped[world] else cut or objection
            ends = {"crash": bool(result.terminated[world]), "timeout": bool(late[world]) and not cut}
            why = failure_of(success=success, dropped=bool(dropped[world]), **ends)
            flown, told = self._flown(world, why, int(phases[world])), made_of(self.policy, world)
            file = self.recorder.finish(world, success=success, path=path, note=note, made_of=told)
            self._landed[world] = flown, file

    def _flown(self, world: int, failure: str, phase: int) -> Flown:
        names, total_reward = self.origin.phases, float(self._returns[world])
        reached = names[phase] if 0 <= phase < len(names) else ""
        return Flown(int(self._seeds[world]), int(self._steps[world]), failure, reached, total_reward)

    def settle(self, *, wait: bool = False) -> np.ndarray:
        """Count the episodes whose files have their names; return the worlds (n,) that flew them.

        Args:
            wait: until there is one, if any is being written.
        """
        if wait and self._landed:
            futures.wait([file for _, file in self._landed.values()], return_when=futures.FIRST_COMPLETED)
        written = np.zeros(self.env.num_envs, bool)
        done = [world for world, (_, file) in self._landed.items() if file.done()]
        for world in sorted(done, key=lambda world: self._landed[world][1].exception() is not None):  # errors last
            flown, file = self._landed.pop(world)
            uid = self._uids[world]
            self.written[uid] = file.result().sha256
            (self.result.failures if flown.failure else self.result.demos).append(flown.seed)
            self.result.flights[uid] = flown
            written[world] = True
        return written


@contextmanager
def _accounted(collector: _Collector, seeds: list[int], progress: bool) -> Iterator[None]:
    """Whatever ends the flight, close its files, bring the index up to date and log the run."""
    clock, started = time.perf_counter(), datetime.now(UTC).isoformat(timespec="seconds")

    def account() -> None:
        result = collector.result
        collector.recorder.close()
        with suppress(AerialError):  # it was raised where it was met
            collector.settle()
        collector.folder.write_index(collector.env.spec, collector.written)
        result.seconds = time.perf_counter() - clock
        counts = {name: len(getattr(result, name)) for name in ("demos", "failures", "skipped", "busy")}
        run = {"started": started, "seconds": round(result.seconds, 3), "num_envs": collector.env.num_envs}
        collector.folder.log({**run, "seeds": [min(seeds), max(seeds)], **counts, "provenance": provenance()})
        log.log(logging.INFO if progress else logging.DEBUG, "%s: %s.", collector.folder.path, result.summary())

    try:
        yield
    except BaseException:
        with suppress(StorageError):  # what went wrong first is what the user must hear of
            account()
        raise
    account()


def _checked(seeds: Iterable[int]) -> list[int]:
    order = [int(seed) for seed in seeds]
    if not order or min(order) < 0 or len(set(order)) < len(order):
        raise InvalidValueError(f"Seeds must be distinct, non-negative and at least one; got {order[:20]}.")
    return order
