"""Who flies: a policy, or the person who takes over from it, and how each hands to the other without a jerk.

While take-over is held the person flies, from the pose in which the vehicle is then; let go, and the policy flies on
from what it sees then, not from what it had planned before. A step between the two commands is spread over a few
ticks. When nobody is at the controls, nobody watches: the vehicle hovers until somebody does.

What is commanded follows from the device's frames, the observations and the policy's actions, never from a clock.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from aerial_il.core.contracts import Policy
from aerial_il.teleop.input.frame import DeviceFrame
from aerial_il.teleop.piloting.command import Command
from aerial_il.teleop.piloting.pilot import ManualPilot

HAND_OVER_TICKS = 15  # 0.3 s, over which the step from one's command to the other's is spread
TAKE_OVER = "take_over"


class Flier(StrEnum):
    """Who flies."""

    POLICY = "policy"
    PERSON = "person"
    NOBODY = "nobody"  # the person has gone: the vehicle hovers, and the policy waits


@dataclass(frozen=True)
class Turn:
    """One tick of shared flight.

    Attributes:
        flier: who flew. action: (Da,) as commanded.
        policy_action: (Da,) what the policy did or would have done; NaN where there is none.
        label: (Da,) what the person meant where they took over, before the step to it was spread; NaN elsewhere.
    """

    flier: Flier
    action: np.ndarray
    policy_action: np.ndarray
    label: np.ndarray

    @property
    def is_intervention(self) -> bool:
        """Whether the person had taken over from the policy."""
        return self.flier is Flier.PERSON and not np.isnan(self.policy_action).any()


class Arbiter:
    """Lets the policy fly, or the person while they hold take-over.

    Args:
        pilot: the person's hands. policy: what flies otherwise, ready for a new episode; None: the person, always.
        hand_over_ticks: over which a step between their commands is spread.
    """

    def __init__(
        self, pilot: ManualPilot, policy: Policy | None = None, *, hand_over_ticks: int = HAND_OVER_TICKS
    ) -> None:
        self.pilot, self.policy, self._ticks = pilot, policy, hand_over_ticks
        self.flier = Flier.PERSON if policy is None else Flier.NOBODY
        self._last: np.ndarray | None = None
        self._step, self._left = np.zeros(0), 0

    def engage(self, obs: Mapping[str, np.ndarray]) -> None:
        """Begin at what the vehicle shows, ``name -> (1, D)``."""
        self.pilot.engage(first_row(obs))
        if self.policy is not None:
            self.policy.reset()

    def act(self, frame: DeviceFrame, obs: Mapping[str, np.ndarray]) -> Turn:
        """Return the turn of the coming tick.

        Args:
            frame: what the device shows. obs: what the vehicle shows, ``name -> (1, D)``.
        """
        intent = self.pilot.watch(frame)
        before, self.flier = self.flier, self._who(TAKE_OVER in intent.held)
        changed = self.flier is not before
        by_policy = self._ask(obs, afresh=changed and self.flier is Flier.POLICY)
        if self.flier is Flier.POLICY:
            self.pilot.command = Command()
            wanted = by_policy
        else:
            if changed:
                self.pilot.engage(first_row(obs), self._last)
            wanted = self.pilot.fly(intent, first_row(obs))
        action = self._smoothed(wanted, changed=changed)
        label = wanted if self.policy is not None and self.flier is Flier.PERSON else np.full_like(wanted, np.nan)
        return Turn(self.flier, action, np.full_like(wanted, np.nan) if self.policy is None else by_policy, label)

    def _who(self, held: bool) -> Flier:
        if self.policy is None:
            return Flier.PERSON
        if self.pilot.dead:
            return Flier.NOBODY
        return Flier.PERSON if held else Flier.POLICY

    def _ask(self, obs: Mapping[str, np.ndarray], *, afresh: bool) -> np.ndarray:
        """Return what the policy does, without what it had planned before if ``afresh``."""
        if self.policy is None:
            return np.zeros(0)
        if afresh:
            self.policy.reset()
        return self.pilot.clip(np.asarray(self.policy.act(obs), float)[0])

    def _smoothed(self, wanted: np.ndarray, *, changed: bool) -> np.ndarray:
        """Return ``wanted`` (Da,) and what is left of the step that the last change of hands has brought."""
        if changed and self._last is not None:
            self._step, self._left = self._last - wanted, self._ticks
        if self._left:
            self._left -= 1
            wanted = self.pilot.clip(wanted + self._left / self._ticks * self._step)
        self._last = wanted
        return wanted


def first_row(obs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return what world 0 shows, ``name -> (D,)``."""
    return {name: values[0] for name, values in obs.items()}
