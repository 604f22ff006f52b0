"""Expert for the slung load: hover over it, lift, line up with the gate, go through, lower it on the mark.

The tool is never sent far ahead, and always a share of the way to where the load hangs: a pivot that moves towards the
load, at a speed that grows with its swing, takes energy out of a pendulum.
"""

import numpy as np

from aerial_il.core.arrays import length, planar_length
from aerial_il.experts.expert import Expert, pointing_down
from aerial_il.suite.episode import measured
from aerial_il.suite.props.slung_load import BEAM_HEIGHT_M, CABLE_M, LOAD_HALF_M
from aerial_il.suite.tasks import carry_slung_load
from aerial_il.suite.tasks.carry_slung_load import AT_REST_M_S

HOVER, LIFT, LINE_UP, THROUGH, CARRY, LOWER = range(6)

SLACK_M = 0.12  # of the cable while the tool hovers over a load that stands
CARRY_HEIGHT_M = BEAM_HEIGHT_M + LOAD_HALF_M + 0.16  # of the load's middle over the ground
SPEED_M_S, LEAD_M, LEAD_UP_M = 0.3, 0.15, 0.05
GAIN, SWING, BRAKING = 1.2, 4.0, 0.3  # 1/s, 1/s and 1: speed of the tool for where the load is to be, hangs, and goes
FOLLOW_S = 0.2
BEFORE_GATE_M, BEYOND_GATE_M = 0.35, 0.30
OVER_M, ON_LINE_M, OFF_LINE_M = 0.03, 0.03, 0.12  # beside the load; beside the gate's axis: ready, and not any more
OVER_GOAL_M, CALM_M_S = 0.03, 0.06

in_gate = measured.vector(carry_slung_load.load_in_gate)
through, set_down = measured.truth(carry_slung_load.through), measured.truth(carry_slung_load.set_down)
eye, height = measured.vector(carry_slung_load.eye), measured.number(carry_slung_load.height)


class CarrySlungLoadExpert(Expert):
    """Servo the load, not the tool; whatever goes wrong, hover over the load again."""

    phase_names = ("hover", "lift", "line_up", "through", "carry", "lower")

    def first_phase(self) -> np.ndarray:
        raised = height(self.view) > 0.5 * CARRY_HEIGHT_M
        return np.where(
            raised, np.where(through(self.view), CARRY, LINE_UP), np.where(set_down(self.view), LOWER, HOVER)
        )

    def next_phase(self) -> np.ndarray:
        view, load = self.view, in_gate(self.view)
        passed, aside = through(view), planar_length(eye(view) - view.tip_pos)
        raised = view.site_pos("load")[:, 2] >= CARRY_HEIGHT_M - 0.03
        slow = planar_length(self._load_vel()) <= CALM_M_S
        ready = (np.abs(load[:, 0] + BEFORE_GATE_M) <= 2.0 * ON_LINE_M) & (np.abs(load[:, 1]) <= ON_LINE_M)
        over_goal = planar_length(self._goal() - view.site_pos("load")) <= OVER_GOAL_M
        rules = (
            (HOVER, aside <= OVER_M, LIFT),
            (LIFT, aside > 3.0 * OVER_M, HOVER),
            (LIFT, raised & passed, CARRY),
            (LIFT, raised, LINE_UP),
            (LINE_UP, ready & slow, THROUGH),
            (THROUGH, passed & (load[:, 0] >= BEYOND_GATE_M), CARRY),
            (THROUGH, (load[:, 0] < -0.1) & (np.abs(load[:, 1]) > OFF_LINE_M), LINE_UP),
            (CARRY, over_goal & slow, LOWER),
            (LOWER, self._standing() & ~set_down(view) & (length(self._load_vel()) <= AT_REST_M_S), HOVER),
        )
        return self.following(rules)

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        view, phase, tip = self.view, self.phase, self.view.tip_pos
        grounded = (phase == HOVER) | (phase == LIFT) | ((phase == LOWER) & self._standing())
        sideways = np.where(grounded[:, None], eye(view) - tip, FOLLOW_S * (self._speed() - view.base_vel))
        sideways *= np.minimum(1.0, LEAD_M / np.maximum(planar_length(sideways), 1e-9))[:, None]
        slack = eye(view)[:, 2] + CABLE_M - SLACK_M - tip[:, 2]
        lift = CARRY_HEIGHT_M - view.site_pos("load")[:, 2]
        lower = np.where(self._standing(), slack, -LEAD_UP_M)
        up = np.select([phase == HOVER, phase == LOWER], [slack, lower], lift)
        position = view.tool_pos + sideways
        position[:, 2] = view.tool_pos[:, 2] + np.clip(up, -LEAD_UP_M, LEAD_UP_M)
        return position, pointing_down(np.zeros(view.n)), np.zeros(view.n)

    def _speed(self) -> np.ndarray:
        """(n, 3) velocity of the tool, world, m/s, that brings the load where it is to be and takes out its swing."""
        view, load, axes = self.view, in_gate(self.view), self.view.site_mat("gate")
        along = np.where(self.phase == THROUGH, 2.0 * BEYOND_GATE_M, -BEFORE_GATE_M) - load[:, 0]
        on_line = _limited(along)[:, None] * axes[:, [0, 3, 6]] - _limited(load[:, 1])[:, None] * axes[:, [1, 4, 7]]
        to_goal = self._goal() - view.site_pos("load")
        to_goal *= (_limited(planar_length(to_goal)) / np.maximum(planar_length(to_goal), 1e-9))[:, None]
        wanted = np.where((self.phase >= CARRY)[:, None], to_goal, on_line)
        return wanted + SWING * (view.site_pos("load") - view.tip_pos) - BRAKING * self._load_vel()

    def _goal(self) -> np.ndarray:
        return self.view.site_pos("goal")

    def _load_vel(self) -> np.ndarray:
        _, speed = self.view.free_joint("load")
        return self.view.qvel[:, speed][:, :3]

    def _standing(self) -> np.ndarray:
        """(n,) bool: the load has met the ground."""
        return self.view.touching("load_on_ground")


def _limited(distance: np.ndarray) -> np.ndarray:
    """(n,) speed, m/s, for a distance (n,) m."""
    return np.clip(GAIN * distance, -SPEED_M_S, SPEED_M_S)


EXPERT = CarrySlungLoadExpert
