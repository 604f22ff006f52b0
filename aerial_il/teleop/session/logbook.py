"""The episodes of a session on disk: a file for each take, discarded ones in the trash, counted by what is there."""

import logging
from collections.abc import Mapping
from concurrent.futures import Future
from contextlib import suppress
from datetime import datetime
from typing import Any

import numpy as np

from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.data.folder import DEMOS, FAILURES, DatasetFolder
from aerial_il.data.provenance import HUMAN, SESSION, Origin
from aerial_il.data.recording.recorder import Recorded, Recorder
from aerial_il.data.recording.writer import EpisodeWriter
from aerial_il.suite.batch import BatchEnvironment, StepResult
from aerial_il.teleop.devices.replay import TOPIC
from aerial_il.teleop.input.frame import LABELS, DeviceFrame
from aerial_il.teleop.piloting.arbiter import Turn
from aerial_il.teleop.session import perturb

log = logging.getLogger(__name__)
POLICY_ACTION = "policy_action"  # topic of what the policy did or would have done, whoever flew
MAY_DIFFER = ("disturbances", "options")  # of a specification, between episodes of one session


class Logbook:
    """Records the flights of one environment with one world into a dataset folder.

    Args:
        env: what is flown. out: the dataset folder; what is there stays, and the session goes on after it.
        operator: who flies. first_seed: of a new folder.
        policy: name of the policy that the operator may take over from; its own actions are then recorded too.
        settings: plain values that all episodes carry.

    Raises:
        InvalidValueError: the folder holds episodes of another environment; names the keys that differ.
    """

    def __init__(
        self,
        env: BatchEnvironment,
        out: str,
        *,
        operator: str,
        first_seed: int = 0,
        policy: str | None = None,
        settings: Mapping[str, Any] | None = None,
    ) -> None:
        self.env, self.folder, self.operator, self.policy = env, DatasetFolder(out), operator, policy
        self._pilot = f"{HUMAN}{operator}" if policy is None else f"{policy} with {HUMAN}{operator}"
        self._settings = {SESSION: datetime.now().astimezone().isoformat(timespec="milliseconds"), **(settings or {})}
        self._refuse_others()
        if parts := self.folder.parts():
            log.warning(
                "%s holds %d recordings that a killed flight left unfinished (.mcap.part). Save what was written: "
                "aerial-il recover path=%s", out, len(parts), out,
            )  # fmt: skip
        self.folder.claim(env.spec)
        self.folder.keep_model(env.model_xml)
        self._recorder = self._new_recorder()
        self._writing: list[Future[Recorded]] = []
        self._trashed: list[str] = []
        self._written: dict[str, str] = {}
        self._uid = ""
        self._first_seed = first_seed
        self.seed = max([first_seed - 1, *self._seeds()]) + 1

    @property
    def recording(self) -> bool:
        """Whether an episode is open."""
        return bool(self._recorder.recording[0])

    @property
    def waiting(self) -> int:
        """How many episodes are still on their way to the disk."""
        return sum(not file.done() for file in self._writing)

    def counts(self) -> dict[str, int]:
        """Return how many episodes lie in the folder, by what became of them."""
        trash = sum(len(list((self.folder.path / "trash" / kind).glob("*.mcap"))) for kind in (DEMOS, FAILURES))
        return {"demos": len(self.folder.files(DEMOS)), "failures": len(self.folder.files(FAILURES)), "trash": trash}

    def begin(self, settings: Mapping[str, Any]) -> None:
        """Open the next take of the present seed; ``settings`` say how it is flown, as plain values."""
        origin = Origin(
            self.env.spec,
            self._pilot,
            {**self._settings, **settings, "take": self._take()},
            self.env.model_xml,
            engine=self.env.engine,
        )
        self._uid = origin.uid(self.seed)
        writer = EpisodeWriter(
            self.folder.file(self._uid),
            self._recorder.layout,
            uid=self._uid,
            provenance=origin.provenance(self.seed, self.env.drawn(self.seed)),
            model_xml=self.env.model_xml,
        )
        self._recorder.begin(0, writer)

    def observe(self, obs: Mapping[str, np.ndarray]) -> None:
        """Note what the world shows before the coming step, or after the last one."""
        self._recorder.observe(obs, state=self.env.get_state(), sim_time=self.env.sim_time)

    def act(self, frame: DeviceFrame, turn: Turn, met: perturb.Disturbance, result: StepResult) -> None:
        """Note what was commanded, by which frame of the device and by whom, what it met, and what came of it."""
        own = {} if self.policy is None else {POLICY_ACTION: turn.policy_action[None]}
        if perturb.possible(self.env):
            own[perturb.TOPIC] = met.to_row()[None]
        self._recorder.act(
            action=turn.action[None],
            executed_action=result.info["executed_action"],
            expert_action=turn.label[None],
            is_intervention=np.full(1, turn.is_intervention),
            phase=np.full(1, -1),
            ctrl=self.env.ctrl,
            reward=result.reward,
            terminated=result.terminated,
            truncated=np.zeros(1, bool),  # a person has all the time that it takes
            **{TOPIC: frame.to_row()[None]},
            **own,
        )

    def save(self, *, success: bool, note: str = "") -> None:
        """Keep the episode as a demonstration or as a failure; threads write it while the flight goes on."""
        kind = DEMOS if success else FAILURES
        self._finish(kind, success=success, note=note)
        self.seed += 1

    def discard(self, *, success: bool) -> None:
        """Put the episode into the trash."""
        self._trashed.append(self._uid)
        self._finish(f"trash/{DEMOS if success else FAILURES}", success=success, note="discarded")

    def forget(self) -> None:
        """Drop the open episode, in which nothing has happened."""
        if self.recording:
            self._recorder.discard(0)

    def start_over(self) -> None:
        """Go on after a writer has failed, or a flight: what is open stays as a ``.part`` file for recovery."""
        old, self._recorder = self._recorder, self._new_recorder()
        self._writing.clear()
        self.seed = max([self._first_seed - 1, *self._seeds()]) + 1
        with suppress(AerialError):  # it was raised where it was met
            old.close()

    def undo(self) -> str | None:
        """Bring back what was discarded last, and return its name; None if there is nothing."""
        self.settle(wait=True)
        if not self._trashed:
            return None
        uid = self._trashed.pop()
        self.folder.restore(uid)
        self._index()
        return uid

    def settle(self, *, wait: bool = False) -> bool:
        """Note which files have their names, and say if any; raise what a writer has met; ``wait`` for those under way.

        Raises:
            StorageError: the disk is full or the folder not writable.
        """
        done = [file for file in self._writing if wait or file.done()]
        self._writing = [file for file in self._writing if file not in done]
        for file in done:
            recorded = file.result()
            self._written[recorded.path.stem] = recorded.sha256
        if done:
            self._index()
        return bool(done)

    def close(self) -> None:
        """Wait for what is being written; an open episode stays as a ``.part`` file, for ``aerial-il recover``."""
        try:
            self.settle(wait=True)
        finally:
            self._recorder.close()

    def _new_recorder(self) -> Recorder:
        own = {} if self.policy is None else {POLICY_ACTION: self.env.spec.action.labels}
        disturbed = {perturb.TOPIC: perturb.LABELS} if perturb.possible(self.env) else {}
        return Recorder(self.env.spec, self.env.ctrl.shape[1], extras={TOPIC: LABELS, **own, **disturbed})

    def _finish(self, kind: str, *, success: bool, note: str) -> None:
        path = self.folder.path / kind / f"{self._uid}.mcap"
        self._writing.append(self._recorder.finish(0, success=success, path=path, note=note))

    def _index(self) -> None:
        self.folder.write_index(self.env.spec, self._written)

    def _take(self) -> int:
        """Return how many takes of the present seed there are already, wherever they lie."""
        return sum(seed == self.seed for seed in self._seeds(trash=True))

    def _seeds(self, *, trash: bool = False) -> list[int]:
        places = ("*/*.mcap*", "trash/*/*.mcap") if trash else ("demos/*.mcap", "failures/*.mcap")
        stems = {file.name.partition(".mcap")[0] for place in places for file in self.folder.path.glob(place)}
        return [int(stem.split("-")[-2]) for stem in stems if stem.count("-") >= 4 and stem.split("-")[-2].isdecimal()]

    def _refuse_others(self) -> None:
        owner, mine = self.folder.spec(), self.env.spec
        if owner is None:
            return
        if differing := owner.differences(mine, ignore=MAY_DIFFER):
            raise InvalidValueError(
                f"{self.folder.path} holds episodes of another environment and cannot be continued. What differs: "
                f"{'; '.join(differing[:3])}. Choose another folder with out=PATH."
            )
