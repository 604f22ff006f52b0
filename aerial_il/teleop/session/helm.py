"""The controls of one environment: a person's hands, the policy that they take over from, and disturbances."""

from aerial_il.core.contracts import BatchEnv, Policy, SeededPolicy, attach
from aerial_il.core.errors import InvalidValueError
from aerial_il.suite.batch import BatchEnvironment, StepResult
from aerial_il.teleop.input.frame import DeviceFrame
from aerial_il.teleop.input.mapping import Bindings
from aerial_il.teleop.piloting.arbiter import Arbiter, Turn
from aerial_il.teleop.piloting.pilot import ManualPilot
from aerial_il.teleop.session.perturb import Disturbance, Perturber


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


class Helm:
    """Flies one environment, tick by tick, by what a person's hands ask for, or by a policy.

    Args:
        env: an environment of one world. bindings: what the device's controls mean. policy: what flies unless the
            person takes over; None if the person always does.

    Attributes:
        obs: what the world shows, ``name -> (1, D)``. absent_ticks: for how long nobody has been at the controls.
    """

    def __init__(self, env: BatchEnvironment, bindings: Bindings, policy: Policy | None, seed: int) -> None:
        self.env, self.bindings = env, bindings
        self.policy = None if policy is None else attach(policy, env)
        self._mode: str | None = None
        self.absent_ticks = 0
        self.reset(seed)

    def reset(self, seed: int) -> None:
        """Set the flight to the start of the episode of ``seed``."""
        self.obs = self.env.reset(seed)
        self.man(seed)

    def man(self, seed: int) -> None:
        """Set new hands to the controls, and the policy to the start of its flight."""
        self.pilot = ManualPilot(self.env.spec, self.env.scenario.robot.vehicle, self.bindings, self._mode)
        self.arbiter = Arbiter(self.pilot, self.policy)
        self.arbiter.engage(self.obs)
        self._perturber = Perturber(self.env, seed)
        if isinstance(self.policy, SeededPolicy):
            self.policy.begin(self.env.seeds)

    def act(self, frame: DeviceFrame) -> Turn:
        """Return what is commanded in the coming step, and by whom."""
        turn = self.arbiter.act(frame, self.obs)
        self._mode = self.pilot.mode
        self.absent_ticks = self.absent_ticks + 1 if self.pilot.dead else 0
        return turn

    def step(self, turn: Turn, pressed: frozenset[str]) -> tuple[Disturbance, StepResult]:
        """Take the step; return what the vehicle met in it, as far as ``pressed`` asks for it, and what came of it."""
        met = self._perturber.step(pressed)
        result = self.env.step(met.meet(self.env, turn.action)[None])
        self.obs = result.obs
        return met, result
