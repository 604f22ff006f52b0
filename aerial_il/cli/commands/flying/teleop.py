"""Fly it yourself, on a page in the browser, and record what you fly: keyboard, gamepad or touch.

On a machine without a screen the page is reached through a tunnel; the line to type is printed. Every episode is asked
for before it is kept; what is kept goes to demos/ or failures/ of the folder, what is discarded to its trash/. The same
command goes on with the session where it stopped.

Example: aerial-il teleop robot=fa_hexa_arm4 task=reach out=datasets/reach_by_hand
Example: aerial-il teleop robot=fa_hexa_arm4 task=pick_place tier=gusts time_scale=0.5 out=datasets/pick_by_hand
Example: aerial-il teleop policy=runs/pick out=datasets/pick_rescued
Example: aerial-il teleop devices=[keyboard,spacemouse] out=datasets/by_mouse
"""

from __future__ import annotations

import asyncio
import getpass
import ssl
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aerial_il.cli.configuration.keys import (
    MISSING,
    MaybeLocated,
    Named,
    TierName,
    at_least,
    check_choices,
    group,
    key,
    output,
    path,
)
from aerial_il.core.errors import InvalidValueError

if TYPE_CHECKING:
    from aerial_il.core.contracts import Policy
    from aerial_il.suite.batch import BatchEnvironment
    from aerial_il.teleop.input.hardware import Driver
    from aerial_il.teleop.input.mapping import Bindings
    from aerial_il.teleop.session.logbook import Logbook

TIME_SCALES = ("1", "0.5", "0.25")
ROBOT, TASK = "fa_hexa_arm4", "reach"
LOOPBACK = ("127.0.0.1", "localhost")


@dataclass
class Config:
    policy: MaybeLocated = path(MaybeLocated, "policy that flies until you take over; expert for the task's own")
    robot: Named | None = group("robot that flies (null: the policy's, or fa_hexa_arm4)")
    task: Named | None = group("task that it does (null: the policy's, or reach)")
    tier: TierName = group("disturbance tier, e.g. gusts, hard-payload, calm+latency", "calm", composed=True)
    controller: Named = group("control law of the base", "geometric_observer")
    out: str = output(MISSING, "folder of the dataset")
    action: str | None = key(
        None, "action level: ee_pose, ee_delta, base_joint or velocity (null: the policy's, or ee_pose)"
    )
    devices: list[str] = key(["keyboard", "gamepad", "touch"], "devices that may be used, files of conf/device")
    controls: str = key("controls", "folder of your own mappings, which the page writes")
    operator: str | None = key(None, "name of the pilot, which is recorded (null: your login name)")
    seed: int = key(0, "of the first episode of a new folder")
    time_scale: str = key("1", "speed of time, which is recorded too", choices=TIME_SCALES)
    hardware: list[str] = key([], "settings of devices that no browser reads, e.g. [leader_arm.port:/dev/ttyACM0]")
    host: str = key("127.0.0.1", "where the page is served; another one than this machine's own needs expose=true")
    expose: bool = key(False, "let other machines reach the page, over https")
    tls: bool | None = key(None, "serve over https (null: where other machines reach it)")
    certificate: str | None = key(None, "PEM file for https (null: one is made, and its fingerprint printed)")
    key_file: str | None = key(None, "PEM file of the certificate's key")
    port: int = key(8642, "of the page; 0 for any that is free")
    size: list[int] = key([360, 480], "height and width of the pictures")
    ui: str = key("browser", "browser, or window: one without tabs, by Chromium", choices=("browser", "window"))
    rerun: bool = key(False, "show the flight in rerun too; a file where there is no screen")
    open: bool = key(True, "open the page, where there is a screen")

    def __post_init__(self) -> None:
        check_choices(self)
        at_least(self, seed=0, port=0)
        if len(self.size) != 2:
            raise InvalidValueError(f"size={self.size} is not height and width, e.g. size=[240,320].")
        if self.host not in LOOPBACK and not self.expose:
            raise InvalidValueError(
                f"host={self.host}: the page is served to this machine alone (host=127.0.0.1), for who reaches it can "
                "try to fly. From elsewhere, take the ssh line that is printed; or say expose=true."
            )
        if (self.certificate is None) != (self.key_file is None):
            raise InvalidValueError("certificate and key_file belong together: give both, or none.")


def run(config: Config) -> None:
    """Fly until interrupted, and say what comes next."""
    from aerial_il.cli.configuration import groups
    from aerial_il.core.rendering import require_rendering
    from aerial_il.teleop.devices import bindings_of, drivers_of
    from aerial_il.teleop.flight import Site, fly
    from aerial_il.teleop.session.cockpit import Cockpit
    from aerial_il.teleop.web.controls import Controls
    from aerial_il.teleop.web.window import window_program
    from aerial_il.workflows.parts.page import greet
    from aerial_il.workflows.parts.sessions import summary

    require_rendering("flying by hand")
    program = window_program() if config.ui == "window" else None
    controls = Controls(partial(groups.read_option, "device"), tuple(config.devices), Path(config.controls))
    mappings = controls.read()
    for name in controls.own:
        print(f"Keys of your own: {controls.file(name)}", flush=True)
    bindings, drivers = bindings_of(mappings), drivers_of(mappings, _settings(config.hardware))
    operator, size = config.operator or getpass.getuser(), (config.size[0], config.size[1])
    site = Site(config.host, config.port, size, _tls(config), controls, partial(summary, config.out))
    opened = partial(greet, open_page=config.open, program=program)
    with _session(config, bindings, drivers, operator) as (env, policy, logbook):
        try:
            cockpit = Cockpit(env, bindings, logbook, policy=policy, time_scale=float(config.time_scale))
            asyncio.run(fly(env, cockpit, bindings, site, operator=operator, drivers=drivers, opened=opened))
        except KeyboardInterrupt:
            _say_what_is_kept(config, logbook)


@contextmanager
def _session(
    config: Config, bindings: Bindings, drivers: Mapping[str, Driver], operator: str
) -> Iterator[tuple[BatchEnvironment, Policy | None, Logbook]]:
    """Open what is flown, the policy aboard and what is recorded; nothing is recorded where a device is missing."""
    from aerial_il.teleop.piloting.command import check_level
    from aerial_il.teleop.piloting.pilot import check_leader
    from aerial_il.teleop.session.logbook import Logbook
    from aerial_il.workflows.parts.watching import watched

    policy, plain = _aboard(config)
    with closing(plain), watched(_flown_once(plain), 1, wanted=config.rerun) as env:
        check_level(env.spec.action.level)
        check_leader(env.spec.action.level, bindings)
        for driver in drivers.values():  # what is not plugged in is named before a folder is taken
            driver.open().close()
        yield (
            env,
            policy,
            Logbook(env, config.out, operator=operator, first_seed=config.seed, policy=config.policy.path),
        )


def _flown_once(env: BatchEnvironment) -> BatchEnvironment:
    """Return ``env`` after a step, for which all that flies is compiled: half a minute where it never was.

    Here Ctrl-C ends that at once; on the thread that flies it would be waited for, and the page would stand still.
    """
    import numpy as np

    from aerial_il.teleop.session.cockpit import by_hand

    by_hand(env).reset(0)
    env.step(np.zeros((1, env.spec.action.size)))
    return env


def _say_what_is_kept(config: Config, logbook: Logbook) -> None:
    """Print how many episodes the dataset holds, and the command that checks them."""
    from aerial_il.cli.configuration import spelling
    from aerial_il.cli.configuration.quoting import command_line
    from aerial_il.workflows.parts.sessions import write_summary

    kept = logbook.counts()
    counted = f"{kept['demos']} demonstrations, {kept['failures']} failures, {kept['trash']} in the trash"
    print(f"\n{config.out}: {counted}.")
    if kept["demos"] or kept["failures"]:
        print(f"Summary: {write_summary(config.out)}")
    if kept["demos"]:
        print(f"Next: {command_line(['validate', spelling.path('path', config.out)])}")


def _settings(words: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return device -> its settings, of words ``DEVICE.SETTING:VALUE``."""
    found: dict[str, dict[str, Any]] = {}
    for word in words:
        (name, _, value), problem = word.partition(":"), f"hardware={word}: write DEVICE.SETTING:VALUE"
        device, _, setting = name.partition(".")
        if not setting or not value:
            raise InvalidValueError(f"{problem}, e.g. hardware=[leader_arm.port:/dev/ttyACM0].")
        found.setdefault(device, {})[setting] = int(value) if value.isdecimal() else value
    return found


def _aboard(config: Config) -> tuple[Policy | None, BatchEnvironment]:
    """Return the policy that flies, if any, and what is flown, with one world."""
    from aerial_il.workflows.parts.environments import EnvironmentReference
    from aerial_il.workflows.parts.pilots import pilot

    robot, task = (group.name if group else None for group in (config.robot, config.task))
    if config.policy.path is None:
        policy, where = None, EnvironmentReference(robot=robot or ROBOT, task=task or TASK, action=config.action)
    else:
        found = pilot(config.policy.path, robot=robot, task=task, action=config.action)
        policy, where = found.policy, found.reference
    return policy, where.load(num_envs=1, threads=1, tier=config.tier.name, controller=config.controller.name)


def _tls(config: Config) -> ssl.SSLContext | None:
    """Return what the page is served with, and say its fingerprint, or what it means to do without."""
    from aerial_il.teleop.web.server import own_address, own_names
    from aerial_il.teleop.web.tls import fresh_certificate, own_certificate

    exposed = config.host not in LOOPBACK
    if not (exposed if config.tls is None else config.tls):
        if exposed:
            print(
                "WARNING: the page is served to other machines without https. Whoever listens on the network reads "
                "its token, and can fly. Phones hand out no sensors to such a page. Leave out tls=false.",
                flush=True,
            )
        return None
    if config.certificate is not None and config.key_file is not None:
        context, fingerprint = own_certificate(config.certificate, config.key_file)
    else:
        context, fingerprint = fresh_certificate([*LOOPBACK, own_address(), *own_names()])
        print("The browser will not know this certificate; compare its fingerprint before you go on.", flush=True)
    print(f"SHA-256 fingerprint: {fingerprint}", flush=True)
    return context
