"""The first of many worlds in rerun while it flies; worlds that nobody watches are simulated by the plain class."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from aerial_il.core.contracts import StepResult
from aerial_il.presentation.rerun import palette, signals
from aerial_il.presentation.rerun.log import SIM_TIME, Clock, Log
from aerial_il.presentation.rerun.motion import Motion, move
from aerial_il.presentation.rerun.scene import log_motion, log_scene, scene_view
from aerial_il.suite.batch import BatchEnvironment

WATCHED = 0  # the world that is shown


class WatchedBatch(BatchEnvironment):
    """Worlds of which the first is logged as it flies, one flight after the other on one timeline.

    Args:
        like: the environment that it stands for. num_threads: 0 for all cores. stream: where the world is shown.
    """

    def __init__(self, like: BatchEnvironment, num_threads: int, stream: rr.RecordingStream) -> None:
        super().__init__(like.scenario, like.num_envs, num_threads)
        self._stream, self._flown = stream, 0
        self.reset(like.seeds)
        motion = self._motion()
        log_scene(self._log("scene"), motion)
        stream.send_blueprint(_layout(motion))

    def reset(self, seeds: np.ndarray | int | None = None, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        obs = super().reset(seeds, mask)
        if mask is None or mask[WATCHED]:
            signals.log_lane(self._log("states"), "flight", np.array([f"seed {int(self.seeds[WATCHED])}"]))
        return obs

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        result = super().step(actions, mask)
        if mask is None or mask[WATCHED]:
            self._flown += 1
            motion = self._motion()
            log_motion(self._log("scene"), motion)
            signals.log_forces(self._log("signals"), motion)
            self._log_answer(actions, result)
        return result

    def _log(self, root: str) -> Log:
        """Return a log at the present moment, in steps and seconds since the start of the first flight."""
        clock = Clock(np.array([self._flown * self.spec.control_dt_s]), first_step=self._flown)
        return Log(self._stream, root, clock)

    def _motion(self) -> Motion:
        return move(self.model, self.get_state()[WATCHED : WATCHED + 1], self.spec)

    def _log_answer(self, actions: np.ndarray, result: StepResult) -> None:
        """Log what was done in the last step, and what came of it."""
        kinds = {"commanded": np.asarray(actions), "executed": result.info["executed_action"]}
        for kind, values in kinds.items():
            one = values[WATCHED : WATCHED + 1]
            signals.log_action(self._log("signals"), self.spec.action, one, kind=kind)
        reward = result.reward[WATCHED : WATCHED + 1, None]
        signals.log_curves(self._log("signals"), "reward", reward, {"reward": palette.REWARD})
        for name, done in zip(self.spec.subtasks, result.info["subtasks"][WATCHED], strict=True):
            signals.log_lane(self._log("states"), name, np.array(["yes" if done else "no"]), yes_no=True)


def _layout(motion: Motion) -> rrb.Blueprint:
    lanes = rrb.StateTimelineView(origin="/states", name="states")
    curves = [
        rrb.TimeSeriesView(origin=f"/signals/{name}", name=name) for name in ("action", "forces/contact", "reward")
    ]
    left = rrb.Vertical(scene_view("/scene", motion), lanes, row_shares=[3, 1])
    time = rrb.TimePanel(state="collapsed", timeline=SIM_TIME)
    return rrb.Blueprint(rrb.Horizontal(left, rrb.Vertical(*curves), column_shares=[1.5, 1]), time, auto_views=False)
