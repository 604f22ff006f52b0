"""Flights by hand, on a page in the browser, recorded."""

from __future__ import annotations

import getpass
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from aerial_il.core.errors import InvalidValueError
from aerial_il.workflows.parts.names import Controller, MaybeRobot, MaybeTask, Tier, at_least

if TYPE_CHECKING:
    import ssl

    from aerial_il.core.contracts import Policy
    from aerial_il.suite.batch import BatchEnvironment
    from aerial_il.teleop.input.hardware import Driver
    from aerial_il.teleop.input.mapping import Bindings
    from aerial_il.teleop.session.logbook import Logbook

TIME_SCALES = (1.0, 0.5, 0.25)
ROBOT, TASK = "fa_hexa_arm4", "reach"
LOOPBACK = ("127.0.0.1", "localhost")


@dataclass(frozen=True, kw_only=True)
class Teleop:
    """Who flies what, and where the page is.

    Attributes:
        policy: policy that flies until you take over; expert for the task's own.
        robot: robot that flies (null: the policy's, or fa_hexa_arm4).
        task: task that it does (null: the policy's, or reach).
        tier: disturbance tier, e.g. gusts, hard-payload, calm+latency.
        controller: control law of the base.
        out: folder of the dataset.
        action: action level: ee_pose, ee_delta, base_joint or velocity (null: the policy's, or ee_pose).
        devices: devices that may be used, files of conf/device.
        controls: folder of your own mappings, which the page writes.
        operator: name of the pilot, which is recorded (null: your login name).
        seed: of the first episode of a new folder.
        time_scale: speed of time, 1, 0.5 or 0.25, which is recorded too.
        hardware: settings of devices that no browser reads, e.g. [leader_arm.port:/dev/ttyACM0].
        host: where the page is served; another one than this machine's own needs expose=true.
        expose: let other machines reach the page, over https.
        tls: serve over https (null: where other machines reach it).
        certificate: PEM file for https (null: one is made, and its fingerprint printed).
        key_file: PEM file of the certificate's key.
        port: of the page; 0 for any that is free.
        size: height and width of the pictures.
        ui: browser, or window: one without tabs, by Chromium.
        rerun: show the flight in rerun too; a file where there is no screen.
        open: open the page, where there is a screen.
    """

    policy: str | None = None
    robot: MaybeRobot = None
    task: MaybeTask = None
    tier: Tier = "calm"
    controller: Controller = "geometric_observer"
    out: str
    action: str | None = None
    devices: tuple[str, ...] = ("keyboard", "gamepad", "touch")
    controls: str = "controls"
    operator: str | None = None
    seed: int = 0
    time_scale: float = 1.0
    hardware: tuple[str, ...] = ()
    host: str = "127.0.0.1"
    expose: bool = False
    tls: bool | None = None
    certificate: str | None = None
    key_file: str | None = None
    port: int = 8642
    size: tuple[int, int] = (360, 480)
    ui: Literal["browser", "window"] = "browser"
    rerun: bool = False
    open: bool = True

    def __post_init__(self) -> None:
        at_least(self, seed=0, port=0)
        if self.time_scale not in TIME_SCALES:
            raise InvalidValueError(f"time_scale={self.time_scale:g} is not one of 1, 0.5, 0.25.")
        if self.host not in LOOPBACK and not self.expose:
            raise InvalidValueError(
                f"host={self.host}: the page is served to this machine alone (host=127.0.0.1), for who reaches it can "
                "try to fly. From elsewhere, take the ssh line that is printed; or say expose=true."
            )
        if (self.certificate is None) != (self.key_file is None):
            raise InvalidValueError("certificate and key_file belong together: give both, or none.")


@dataclass(frozen=True)
class Kept:
    """How many episodes a folder holds in the end, and its summary, if there is anything to sum up."""

    demos: int
    failures: int
    trash: int
    summary: Path | None


def teleop(settings: Teleop) -> Kept | None:
    """Fly until interrupted; return what is kept then, None where the session ended otherwise."""
    import asyncio

    from aerial_il.core import presets
    from aerial_il.core.rendering import require_rendering
    from aerial_il.teleop.devices import bindings_of, drivers_of
    from aerial_il.teleop.flight import Site, fly
    from aerial_il.teleop.session.cockpit import Cockpit
    from aerial_il.teleop.web.controls import Controls
    from aerial_il.teleop.web.window import window_program
    from aerial_il.workflows.parts.page import greet
    from aerial_il.workflows.parts.sessions import summary

    require_rendering("flying by hand")
    program = window_program() if settings.ui == "window" else None
    controls = Controls(partial(presets.read, "device"), settings.devices, Path(settings.controls))
    mappings = controls.read()
    for name in controls.own:
        print(f"Keys of your own: {controls.file(name)}", flush=True)
    bindings, drivers = bindings_of(mappings), drivers_of(mappings, _hardware(settings.hardware))
    operator, size = settings.operator or getpass.getuser(), settings.size
    site = Site(settings.host, settings.port, size, _tls(settings), controls, partial(summary, settings.out))
    opened = partial(greet, open_page=settings.open, program=program)
    with _session(settings, bindings, drivers, operator) as (env, policy, logbook):
        try:
            cockpit = Cockpit(env, bindings, logbook, policy=policy, time_scale=settings.time_scale)
            asyncio.run(fly(env, cockpit, bindings, site, operator=operator, drivers=drivers, opened=opened))
        except KeyboardInterrupt:
            return _kept(settings, logbook)
    return None


@contextmanager
def _session(
    settings: Teleop, bindings: Bindings, drivers: Mapping[str, Driver], operator: str
) -> Iterator[tuple[BatchEnvironment, Policy | None, Logbook]]:
    """Open what is flown, the policy aboard and what is recorded; nothing is recorded where a device is missing."""
    from aerial_il.teleop.piloting.command import check_level
    from aerial_il.teleop.piloting.pilot import check_leader
    from aerial_il.teleop.session.logbook import Logbook
    from aerial_il.workflows.parts.watching import watched

    policy, plain = _aboard(settings)
    with closing(plain), watched(_flown_once(plain), 1, wanted=settings.rerun) as env:
        check_level(env.spec.action.level)
        check_leader(env.spec.action.level, bindings)
        for driver in drivers.values():  # what is not plugged in is named before a folder is taken
            driver.open().close()
        yield (
            env,
            policy,
            Logbook(env, settings.out, operator=operator, first_seed=settings.seed, policy=settings.policy),
        )


def _flown_once(env: BatchEnvironment) -> BatchEnvironment:
    """Return ``env`` after a step, for which all that flies is compiled: half a minute where it never was.

    Here Ctrl-C ends that at once; on the thread that flies it would be waited for, and the page would stand still.
    """
    import numpy as np

    from aerial_il.teleop.session.helm import by_hand

    by_hand(env).reset(0)
    env.step(np.zeros((1, env.spec.action.size)))
    return env


def _kept(settings: Teleop, logbook: Logbook) -> Kept:
    from aerial_il.workflows.parts.sessions import write_summary

    kept = logbook.counts()
    summary = write_summary(settings.out) if kept["demos"] or kept["failures"] else None
    return Kept(kept["demos"], kept["failures"], kept["trash"], summary)


def _hardware(words: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return device -> its settings, of words ``DEVICE.SETTING:VALUE``; numbers are read as such."""
    chosen: dict[str, dict[str, Any]] = {}
    for word in words:
        (name, _, value), problem = word.partition(":"), f"hardware={word}: write DEVICE.SETTING:VALUE"
        device, _, setting = name.partition(".")
        if not setting or not value:
            raise InvalidValueError(f"{problem}, e.g. hardware=[leader_arm.port:/dev/ttyACM0].")
        chosen.setdefault(device, {})[setting] = int(value) if value.isdecimal() else value
    return chosen


def _aboard(settings: Teleop) -> tuple[Policy | None, BatchEnvironment]:
    """Return the policy that flies, if any, and what is flown, with one world."""
    from aerial_il.workflows.parts.environments import EnvironmentReference
    from aerial_il.workflows.parts.pilots import pilot

    robot, task = settings.robot, settings.task
    if settings.policy is None:
        policy, where = None, EnvironmentReference(robot=robot or ROBOT, task=task or TASK, action=settings.action)
    else:
        aboard = pilot(settings.policy, robot=robot, task=task, action=settings.action)
        policy, where = aboard.policy, aboard.reference
    return policy, where.load(num_envs=1, threads=1, tier=settings.tier, controller=settings.controller)


def _tls(settings: Teleop) -> ssl.SSLContext | None:
    """Return what the page is served with, and say its fingerprint, or what it means to do without."""
    from aerial_il.teleop.web.access import own_address, own_names
    from aerial_il.teleop.web.tls import fresh_certificate, own_certificate

    exposed = settings.host not in LOOPBACK
    if not (exposed if settings.tls is None else settings.tls):
        if exposed:
            print(
                "WARNING: the page is served to other machines without https. Whoever listens on the network reads "
                "its token, and can fly. Phones hand out no sensors to such a page. Leave out tls=false.",
                flush=True,
            )
        return None
    if settings.certificate is not None and settings.key_file is not None:
        context, fingerprint = own_certificate(settings.certificate, settings.key_file)
    else:
        context, fingerprint = fresh_certificate([*LOOPBACK, own_address(), *own_names()])
        print("The browser will not know this certificate; compare its fingerprint before you go on.", flush=True)
    print(f"SHA-256 fingerprint: {fingerprint}", flush=True)
    return context
