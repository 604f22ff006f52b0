"""An exported policy on the robot's computer: NumPy, onnxruntime and what the link needs; no torch and no MuJoCo.

``python -m aerial_il.links.onboard policy=FOLDER link=NAME seconds=30 out=flight.npz link.KEY=VALUE ...``

The robot is in the air already, or is simulated: then ``seed=0`` lets it begin the episode of that seed. What is flown
is written as transitions, which ``aerial_il.open_dataset`` reads; images are left out.
"""

import math
import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aerial_il.core import registry
from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.links.guard import Guard
from aerial_il.links.link import Link
from aerial_il.links.loop import RobotLoop
from aerial_il.links.pilot import LinkPilot, ticks_to_think
from aerial_il.policies.parts.exported import load_exported
from aerial_il.policies.parts.flying import FlyingPolicy

KEYS = ("policy", "link", "seconds", "seed", "out")


@dataclass(frozen=True)
class Flight:
    """What was flown.

    Attributes:
        obs: name -> (T + 1, ...). actions: (T, Da). sent: (T,) bool, the guard did not object to it.
        loop: how it kept time. why: it ended; empty for its time.
    """

    obs: dict[str, np.ndarray]
    actions: np.ndarray
    sent: np.ndarray
    loop: RobotLoop
    why: str

    def save(self, path: Path) -> None:
        """Write transitions with the names of what the observations hold, one for each tick that an action was sent in.

        Where the robot held by itself, one piece of the flight ends and another begins.
        """
        spec = self.loop.spec.observation
        seen = spec.flatten(self.obs, spec.state_names)
        labels = [label for name in spec.state_names for label in spec[name].element_labels()]
        rows = np.flatnonzero(self.sent)
        np.savez_compressed(
            path, observations=seen[:-1][rows], next_observations=seen[1:][rows], actions=self.actions[rows],
            truncations=np.diff(rows, append=-1) != 1, timestamps=self.loop.spec.control_dt_s * rows,
            labels=np.array(labels),
        )  # fmt: skip


def fly(
    policy: FlyingPolicy, link: Link, *, seconds: float, seed: int | None = None, guard: Guard | None = None
) -> Flight:
    """Fly a robot by a policy for some seconds of its time, or until it succeeds, crashes, lands or leaves the fence.

    Args:
        policy: what flies. link: to the robot, which is in the air unless there is a ``seed``.
        seed: of the episode that a simulated robot begins. guard: what must hold.

    Raises:
        InvalidValueError: the policy does not suit the robot. LinkError: the robot is not in the air, or is lost.
    """
    if not 0.0 < seconds < math.inf:
        raise InvalidValueError(f"seconds is {seconds:g}; it must be positive.")
    policy.check(link.spec)
    loop, dt = RobotLoop(link, guard), link.spec.control_dt_s
    own = policy.fresh()
    own.take_on(link.spec)
    if ticks := 0 if link.lockstep else ticks_to_think(own, loop.look(), dt):
        own = policy.executing(policy.execution, thinking=ticks)
        own.take_on(link.spec)
    pilot = LinkPilot(own, think_ticks=ticks)
    pilot.loop = loop
    loop.join() if seed is None else loop.begin(seed)
    pilot.reset()
    began, ticks, why = dict(loop.obs), list[tuple[np.ndarray, bool, dict[str, np.ndarray]]](), ""
    try:
        while not why and len(ticks) < round(seconds / dt):
            action, held = pilot.act({name: value[None] for name, value in loop.obs.items()})[0], loop.held
            loop.tick(action)
            ticks.append((action, loop.held == held, dict(loop.obs)))
            ends = ("success", "crash", "dropped")
            why = loop.trouble if loop.watch.over else next((each for each in ends if loop.told.get(each)), "")
    except KeyboardInterrupt:
        why = "interrupted"
    finally:
        pilot.close()
    seen = [began, *(obs for *_, obs in ticks)]
    actions = np.reshape([action for action, *_ in ticks], (-1, loop.spec.action.size))
    sent = np.array([each for _, each, _ in ticks], bool)
    return Flight({name: np.array([each[name] for each in seen]) for name in began}, actions, sent, loop, why)


def main(words: Sequence[str], here: Callable[[], Any] | None = None) -> int:
    """Fly as the words of a command line say, print what came of it, and return the exit status."""
    try:
        said, out = _said(words)
        own = {name.removeprefix("link."): _value(value) for name, value in said.items() if name.startswith("link.")}
        settings = registry.get("link", said["link"])(**own)
        policy = load_exported(Path(said["policy"]))
        seed = int(said["seed"]) if "seed" in said else None
        with closing(settings.connect(here or _elsewhere, level=policy.spec.action.level)) as link:
            flight = fly(policy, link, seconds=float(said.get("seconds", 30)), seed=seed)
    except (AerialError, ValueError, TypeError) as error:
        print(error, file=sys.stderr)
        return 2
    if out:
        flight.save(out)
    held = f", {flight.loop.held} held" if flight.loop.held else ""
    print(f"{len(flight.actions)} ticks{held}{': ' + flight.why if flight.why else ''}. {flight.loop.timing.summary()}")
    return 0


def _said(words: Sequence[str]) -> tuple[dict[str, str], Path | None]:
    """Return what was said, by its keys, and the file to write, which is not there yet.

    Raises:
        InvalidValueError: a key is missing or unknown, or the file cannot be written.
    """
    usage = (__doc__ or "").splitlines()[2]
    said = {name: value for name, _, value in (word.partition("=") for word in words)}
    if unknown := [name for name in said if name not in KEYS and not name.startswith("link.")]:
        raise InvalidValueError(f"Unknown key {unknown[0]!r}. Valid: {', '.join(KEYS)}, link.KEY. {usage}")
    if missing := [name for name in ("policy", "link") if name not in said]:
        raise InvalidValueError(f"{missing[0]}=... is missing. {usage}")
    out = Path(said["out"]) if "out" in said else None
    if out and (out.suffix != ".npz" or out.exists() or not out.parent.is_dir()):
        raise InvalidValueError(f"out={out} must be a new file NAME.npz, in a folder that is there.")
    return said, out


def _elsewhere() -> Any:
    raise InvalidValueError("link=simulated flies no robot: simulations need MuJoCo; try aerial-il fly.")


def _value(text: str) -> Any:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return {"true": True, "false": False, "null": None}.get(text, text)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
