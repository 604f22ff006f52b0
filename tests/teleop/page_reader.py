"""Somebody at the page who knows nothing but what it shows, and does nothing but press its keys or move a gamepad.

The page's text is read from its document: state, ticks on the list of sub-tasks, numbers to fly by, questions. No state
of the simulator, no picture and no message of the server is looked at.
"""

import asyncio
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from tests.patience import HANG_S
from tests.teleop.chromium import Tab

LOOK_S = 0.05  # between two looks at the page
LAG_S = 0.35  # from a key to a vehicle that answers: what is nearer than it moves in this time is done by taps
REST_S = 0.45  # after a tap, until it has had its effect
AHEAD_S, MEMORY_S = 0.15, 0.25  # motions are thought ahead by, and their speed is judged over
CAREFUL = 0.8  # share of the way that a tap is meant to go
DEAF_S = 0.04  # of a tap, for which a key has no effect to speak of: it takes 150 ms to full speed
TOOL_CM_S, YAW_DEG_S, WRIST_DEG_S, PRECISE = 40.0, 51.0, 46.0, 0.3  # as the help and the manual say
SEE = """(() => {
  const text = (id) => document.getElementById(id)?.textContent ?? "";
  const shown = (id) => Boolean(document.getElementById(id)?.checkVisibility());
  const cells = (row) => [...row.cells].map((cell) => cell.textContent);
  return {
    state: text("state"), message: text("message"), mode: document.querySelector("#modes .on")?.textContent ?? "",
    ticks: [...document.querySelectorAll("#subtasks .met")].map((e) => e.textContent),
    verdict: shown("review") ? text("verdict") : "", banner: shown("banner") ? text("banner-title") : "",
    flier: text("who"), counts: ["demos", "failures", "trash"].map((kind) => text(`count-${kind}`)),
    rows: shown("readings") ? [...document.querySelectorAll("#readings tr")].map(cells) : [],
  };
})()"""
NEGATIVE = frozenset({"back", "right", "down", "nose up", "roll left"})
KEYS = {
    "forward+": "KeyW", "forward-": "KeyS", "lateral+": "KeyA", "lateral-": "KeyD", "up+": "KeyE", "up-": "KeyQ",
    "yaw+": "ArrowLeft", "yaw-": "ArrowRight", "grip+": "Space", "grip-": "KeyF", "precision": "ShiftLeft",
    "mode": "Tab", "record": "KeyR", "save": "Enter", "discard": "Backspace", "undo": "KeyU", "label": "KeyL",
    "pause": "KeyP", "take_over": "KeyT",
}  # fmt: skip
BUTTONS = {"precision": 4, "take_over": 5, "mode": 3, "record": 9, "save": 2, "discard": 8, "undo": 13, "pause": 10}
PAD = """
window.mock = {axes: [0, 0, 0, 0], buttons: Array.from({length: 17}, () => ({pressed: false, value: 0})),
               connected: true, mapping: "standard", id: "mock", index: 0};
navigator.getGamepads = () => [window.mock];
"""


@dataclass(frozen=True)
class Sight:
    """What the page shows at a glance.

    Attributes:
        state: of the session, in the page's words. mode: of the sticks. ticks: sub-tasks that are met. verdict: of the
            flight that is to be kept or not. message, banner: other words. counts: saved, failures, in the trash.
        flier: who flies, in the page's words, where a policy does too.
        numbers: title -> numbers to fly by, in cm and degrees; ahead, left, up and nose down are positive.
    """

    state: str = ""
    mode: str = ""
    ticks: frozenset[str] = frozenset()
    verdict: str = ""
    message: str = ""
    banner: str = ""
    counts: tuple[int, ...] = ()
    numbers: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    flier: str = ""


def read_number(text: str) -> float:
    """Return the number in a cell such as ``back 34.6`` or ``nose up 46°``."""
    word, _, number = text.rpartition(" ")
    value = float(number.rstrip("°%"))
    return -value if word in NEGATIVE else value


async def look(tab: Tab) -> Sight:
    """Look at the page."""
    seen = await tab.value(SEE)
    rows = {title: tuple(map(read_number, filter(None, cells))) for title, *cells in seen["rows"]}
    return Sight(
        seen["state"], seen["mode"], frozenset(seen["ticks"]), seen["verdict"], seen["message"], seen["banner"],
        tuple(int(count) for count in seen["counts"] if count), rows, seen["flier"],
    )  # fmt: skip


@dataclass(frozen=True)
class Wish:
    """What a person wants to happen next.

    Attributes:
        moves: motion -> how far, and how near is near enough, in cm or degrees. mode: of the sticks. precise: slowly.
        grip: 1 to close, -1 to open. over: to give the flight up.
    """

    moves: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    mode: str = "tool"
    precise: bool = False
    grip: int = 0
    over: bool = False


def speed_of(motion: str, wish: Wish) -> float:
    """Return how fast a motion is at full stick, cm/s or °/s."""
    turning = wish.mode == "wrist" and motion in ("forward", "lateral")
    full = YAW_DEG_S if motion == "yaw" else WRIST_DEG_S if turning else TOOL_CM_S
    return PRECISE * full if wish.precise else full


class Foresight:
    """Where things will be in a moment: what is on its way needs no further push."""

    def __init__(self) -> None:
        self._seen: dict[str, tuple[float, float, float]] = {}  # motion -> when, how far, how fast

    def __call__(self, motion: str, wish: Wish) -> float:
        """Return how far there is still to push, or zero if that is near enough, now and in a moment."""
        if motion not in wish.moves:
            self._seen.pop(motion, None)
            return 0.0
        (far, enough), now = wish.moves[motion], time.monotonic()
        when, before, rate = self._seen.get(motion, (now - 1.0, far, 0.0))
        fresh = (far - before) / (now - when)
        rate = rate + (fresh - rate) * min(1.0, (now - when) / MEMORY_S)
        if abs(fresh) > 4.0 * speed_of(motion, Wish(mode=wish.mode)):
            rate = 0.0  # it is another thing that is aimed at
        self._seen[motion] = (now, far, rate)
        soon = far + AHEAD_S * rate
        return soon if max(abs(soon), 0.5 * abs(far)) > enough else 0.0


class Hands(Protocol):
    """How a wish becomes motions of fingers."""

    async def do(self, wish: Wish) -> None:
        """Move the fingers for the coming moment."""
        ...

    async def tap(self, command: str) -> None:
        """Press a control and let go of it."""
        ...

    async def hold(self, command: str, *, down: bool) -> None:
        """Press a control, or let go of it."""
        ...

    async def rest(self) -> None:
        """Let go of everything but what is held on purpose."""
        ...


class KeyHands:
    """Fingers on a keyboard: keys are held for what is far, and tapped, for as long as it takes, for what is near."""

    def __init__(self, tab: Tab) -> None:
        self._tab, self._down = tab, set[str]()
        self._busy: dict[str, float] = {}  # motion -> when its last tap has had its effect
        self._taps = set[asyncio.Task[None]]()
        self._foresight = Foresight()

    async def do(self, wish: Wish) -> None:
        await self._set("precision", wish.precise)
        for sign, key in ((1, "grip+"), (-1, "grip-")):
            await self._set(key, wish.grip == sign)
        for motion in ("forward", "lateral", "up", "yaw"):
            await self._move(motion, self._foresight(motion, wish), speed_of(motion, wish))

    async def _move(self, motion: str, far: float, speed: float) -> None:
        now = time.monotonic()
        if self._busy.get(motion, 0.0) > now:
            return
        held = abs(far) > LAG_S * speed
        for sign, key in ((1.0, f"{motion}+"), (-1.0, f"{motion}-")):
            await self._set(key, held and sign * far > 0.0)
        if far and not held:
            seconds = DEAF_S + CAREFUL * abs(far) / speed
            self._busy[motion] = now + seconds + REST_S
            tap = asyncio.create_task(self._tap(motion + ("+" if far > 0.0 else "-"), seconds))
            self._taps.add(tap)
            tap.add_done_callback(self._taps.discard)

    async def _tap(self, command: str, seconds: float) -> None:
        await self._set(command, True)
        await asyncio.sleep(seconds)
        await self._set(command, False)

    async def tap(self, command: str) -> None:
        await self._tab.tap(KEYS[command])

    async def hold(self, command: str, *, down: bool) -> None:
        await self._set(command, down)

    async def rest(self) -> None:
        if self._taps:
            await asyncio.wait(set(self._taps))
        for command in self._down - {"take_over"}:
            await self._set(command, False)

    async def _set(self, command: str, down: bool) -> None:
        if down != (command in self._down):
            (self._down.add if down else self._down.discard)(command)
            await self._tab.key(KEYS[command], down=down)


class PadHands:
    """Thumbs on a gamepad that the browser is made to see: sticks are pushed the farther, the more there is to go."""

    def __init__(self, tab: Tab) -> None:
        self._tab, self._foresight = tab, Foresight()

    async def plug_in(self) -> None:
        """Connect it."""
        await self._tab.value(PAD + "1")

    async def do(self, wish: Wish) -> None:
        motions = ("forward", "lateral", "up", "yaw")
        value = {m: self._push(self._foresight(m, wish) / speed_of(m, wish)) for m in motions}
        axes = [-value["yaw"], -value["up"], -value["lateral"], -value["forward"]]
        pressed = {4: wish.precise, 6: wish.grip < 0, 7: wish.grip > 0}
        buttons = [f"mock.buttons[{i}] = {_button(down)}" for i, down in pressed.items()]
        await self._tab.value(f"mock.axes = {axes}; {'; '.join(buttons)}; 1")

    @staticmethod
    def _push(seconds: float) -> float:
        """Return the stick's position for what takes so many seconds at full speed."""
        share = min(1.0, abs(seconds) / (2.0 * LAG_S))
        return math.copysign(0.12 + 0.88 * share, seconds) if share > 0.01 else 0.0

    async def tap(self, command: str) -> None:
        await self.hold(command, down=True)
        await asyncio.sleep(0.1)
        await self.hold(command, down=False)

    async def hold(self, command: str, *, down: bool) -> None:
        await self._tab.value(f"mock.buttons[{BUTTONS[command]}] = {_button(down)}; 1")

    async def rest(self) -> None:
        await self.do(Wish())


def _button(down: bool) -> str:
    return f"{{pressed: {str(down).lower()}, value: {int(down)}}}"


Plan = Callable[[Sight], Wish]  # keeps in mind where it is


class PageReader:
    """Flies what the page shows.

    Args:
        tab: the page. hands: what is moved.
    """

    def __init__(self, tab: Tab, hands: Hands) -> None:
        self.tab, self.hands = tab, hands
        self.sight = Sight()

    async def until(self, seen: Callable[[Sight], bool]) -> Sight:
        """Wait until the page shows something."""
        end = time.monotonic() + HANG_S
        while time.monotonic() < end:
            self.sight = await look(self.tab)
            if seen(self.sight):
                return self.sight
            await asyncio.sleep(LOOK_S)
        raise AssertionError(f"waited for {HANG_S} s; the page shows {self.sight}")

    async def record(self) -> None:
        """Begin an episode."""
        await self.until(lambda s: s.state == "free flight" and bool(s.mode) and not s.banner)
        await self.hands.tap("record")
        await self.until(lambda s: s.state == "recording")

    async def fly(self, plan: Plan, limit_s: float) -> bool:
        """Fly the episode by a plan until the page asks what to do with it, or patience ends; say if it was solved."""
        end = time.monotonic() + limit_s
        while (sight := await look(self.tab)).state in ("recording", "paused"):
            self.sight = sight
            if sight.state == "paused":
                await self.hands.tap("pause")
                await asyncio.sleep(REST_S)
            elif time.monotonic() > end or (wish := plan(sight)).over:
                await self.hands.rest()
                await self.hands.tap("record")
                break
            else:
                await self._step(wish)
            await asyncio.sleep(LOOK_S)
        await self.hands.rest()
        return (await self.until(lambda s: bool(s.verdict))).verdict == "Solved"

    async def _step(self, wish: Wish) -> None:
        if wish.mode != self.sight.mode:
            await self.hands.rest()
            before = self.sight.mode
            await self.hands.tap("mode")
            await self.until(lambda s: s.mode != before or s.state != "recording")
            return
        await self.hands.do(wish)

    async def keep(self) -> None:
        """Keep what was flown."""
        await self.hands.tap("save")
        await self.until(lambda s: s.state == "free flight")
