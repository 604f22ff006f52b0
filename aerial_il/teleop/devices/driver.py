"""A model of a person at the sticks, in real time on a page or faster than that without one: for studies and tests.

It sees what the page gets, see :mod:`aerial_il.teleop.driver`; whoever ticks the cockpit shows it the status.
"""

from collections.abc import Sequence

from aerial_il.core.seeding import named_rng
from aerial_il.teleop.driver.eyes import Eyes, Sight
from aerial_il.teleop.driver.habit import Habit
from aerial_il.teleop.driver.hand import Hand
from aerial_il.teleop.driver.plan import plan_for
from aerial_il.teleop.driver.watch import Judgement, Watch
from aerial_il.teleop.input.frame import AXES, DeviceFrame, bits_of
from aerial_il.teleop.input.mapping import HELD, PRESSED, Bindings
from aerial_il.teleop.session.readings import Reading
from aerial_il.teleop.session.status import Status

CONTROLS = tuple(f"driver:{command}" for command in ("grip+", "grip-", *HELD, *PRESSED))
BINDINGS = Bindings(
    {name: name.removeprefix("driver:") for name in CONTROLS},
    {"forward": ("-right_y",), "lateral": ("-right_x",), "up": ("-left_y",), "yaw": ("-left_x",)},
)
REACTION_S = 0.25
LONGEST_TICKS = 2_500  # 50 s: then it gives up and keeps the flight as a failure
BETWEEN_TICKS = 15  # that it leaves between two presses


class Driver:
    """A person who records one episode after the other.

    Args:
        task: what is to be done. readings: the numbers of the page.
        dt: s, of a tick. seed: of its habits, errors, tremor and stops. judgement: when it takes over from a policy.
    """

    def __init__(
        self,
        task: str,
        readings: Sequence[Reading],
        *,
        dt: float,
        seed: int = 0,
        judgement: Judgement | None = None,
    ) -> None:
        self._plan, self._readings, self._dt = plan_for(task), readings, dt
        self._judgement, self._seed = judgement or Judgement(), seed
        self._seen: Sight | None = None
        self._ticks = self._pressed = self._held = 0
        self._flying, self._delicate, self._episodes = False, False, 0
        self._state = ""

    def see(self, status: Status) -> None:
        """Look at the page."""
        if status.state != self._state:
            self._state = status.state
            if status.state == "recording":
                self._begin(status)
        self._seen = self._eyes.look(status) if self._state == "recording" else None

    def frame(self) -> DeviceFrame:
        self._ticks += 1
        names, axes = self._hands()
        held = bits_of((f"driver:{name}" for name in names), BINDINGS.controls)
        edges, self._held = held & ~self._held, held
        positions = tuple(axes.get(name, 0.0) for name in AXES)
        return DeviceFrame(self._ticks, positions, held, edges, 1000.0 * self._dt * self._ticks)

    def _begin(self, status: Status) -> None:
        """Sit down to another episode: another habit, other errors."""
        rng = named_rng(status.seed, "driver", str(self._seed), str(self._episodes))
        reaction = round(REACTION_S / self._dt)
        self.habit = Habit.draw(rng)
        self._eyes = Eyes(self._readings, reaction_ticks=reaction, rng=rng)
        self._hand = Hand(self.habit, reaction_ticks=reaction, dt=self._dt, rng=rng)
        self._watch, self._flying, self._delicate = Watch(self._judgement), False, False
        self._episodes += 1

    def _hands(self) -> tuple[list[str], dict[str, float]]:
        """Return the buttons that are held and where the sticks are."""
        if self._seen is None:
            wanted = {"idle": "record", "paused": "pause", "review": "save"}.get(self._state)
            return ([wanted] if wanted and self._may_press() else []), {}
        if self._seen.status.steps > LONGEST_TICKS and self._may_press():
            return ["record"], {}
        return self._fly(self._seen)

    def _fly(self, sight: Sight) -> tuple[list[str], dict[str, float]]:
        left = self._plan.left(sight)
        if sight.status.shared and not self._watch.judge(left, delicate=self._delicate):
            self._flying = self._delicate = False
            return [], {}
        if not self._flying:
            self._flying = True
            self._plan.begin(sight, self.habit)
            self._hand.rest()
        wish = self._plan.wish(sight)
        if wish.hopeless and self._may_press():
            return ["record"], {}
        self._delicate = wish.fine or wish.unfinished
        names = ["take_over"] if sight.status.shared else []
        names += ["precision"] if wish.fine else []
        names += {1: ["grip+"], -1: ["grip-"]}.get(wish.grip, [])
        if sight.status.mode != wish.mode:
            return ([*names, "mode"] if self._may_press() else names), {}
        ahead, aside, up, turn = self._hand.sticks(wish)
        return names, {"right_y": -ahead, "right_x": -aside, "left_y": -up, "left_x": -turn}

    def _may_press(self) -> bool:
        """Return whether it is time for another press of a button, and take note of it."""
        if self._ticks - self._pressed < BETWEEN_TICKS:
            return False
        self._pressed = self._ticks
        return True
