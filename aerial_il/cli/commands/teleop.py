"""Fly it yourself, on a page in the browser, and record what you fly: keyboard, gamepad or touch.

On a machine without a screen the page is reached through a tunnel; the line to type is printed. Every episode is asked
for before it is kept; what is kept goes to demos/ or failures/ of the folder, what is discarded to its trash/. The same
command goes on with the session where it stopped.

Example: aerial-il teleop robot=fa_hexa_arm4 task=reach out=datasets/reach_by_hand
Example: aerial-il teleop robot=fa_hexa_arm4 task=pick_place tier=gusts time_scale=0.5 out=datasets/pick_by_hand
Example: aerial-il teleop devices=[keyboard,spacemouse] out=datasets/by_mouse
"""

from __future__ import annotations

import asyncio
import getpass
import ssl
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from aerial_il.cli.configuration.keys import MISSING, Named, TierName, at_least, check_choices, group, key, output
from aerial_il.core.errors import InvalidValueError

if TYPE_CHECKING:
    from aerial_il.teleop.server import Server

TIME_SCALES = ("1", "0.5", "0.25")
LOOPBACK = ("127.0.0.1", "localhost")


@dataclass
class Config:
    robot: Named = group("which vehicle", "fa_hexa_arm4")
    task: Named = group("what it does", "reach")
    tier: TierName = group("how rough the air is, e.g. gusts, hard-payload, calm+latency", "calm", composed=True)
    controller: Named = group("which law flies the base", "geometric_observer")
    out: str = output(MISSING, "folder of the dataset")
    action: str = key("ee_pose", "action level that is recorded: ee_pose, ee_delta, base_joint or velocity")
    devices: list[str] = key(["keyboard", "gamepad", "touch"], "devices that may be used, files of conf/device")
    operator: str | None = key(None, "who flies, for the record (null: the name you are logged in by)")
    seed: int = key(0, "of the first episode of a new folder")
    time_scale: str = key("1", "how fast time passes, for the record too", choices=TIME_SCALES)
    hardware: dict[str, Any] = key({}, "of devices that no browser reads, e.g. {leader_arm:{port:/dev/ttyACM0}}")
    host: str = key("127.0.0.1", "where the page is served; another one than this machine's own needs expose=true")
    expose: bool = key(False, "let other machines reach the page, over https")
    tls: bool | None = key(None, "serve over https (null: where other machines reach it)")
    certificate: str | None = key(None, "PEM file for https (null: one is made, and its fingerprint told)")
    key_file: str | None = key(None, "PEM file of the certificate's key")
    port: int = key(8642, "of the page; 0 for any that is free")
    size: list[int] = key([360, 480], "height and width of the pictures")
    open: bool = key(True, "open the page, where there is a screen")

    def __post_init__(self) -> None:
        check_choices(self)
        at_least(self, seed=0, port=0)
        if self.host not in LOOPBACK and not self.expose:
            raise InvalidValueError(
                f"host={self.host}: the page is served to this machine alone (host=127.0.0.1), for who reaches it can "
                "try to fly. From elsewhere, take the ssh line that is printed; or say expose=true."
            )
        if (self.certificate is None) != (self.key_file is None):
            raise InvalidValueError("certificate and key_file belong together: give both, or none.")


def run(config: Config) -> None:
    """Fly until interrupted, and say what comes next."""
    import aerial_il
    from aerial_il.cli.configuration import groups, spelling
    from aerial_il.cli.configuration.quoting import command_line
    from aerial_il.core.rendering import require_rendering
    from aerial_il.teleop.cockpit import Cockpit
    from aerial_il.teleop.command import check_level
    from aerial_il.teleop.devices import bindings_of, drivers_of
    from aerial_il.teleop.flight import Site, fly
    from aerial_il.teleop.logbook import Logbook
    from aerial_il.teleop.pilot import check_leader

    require_rendering("flying by hand")
    check_level(config.action)
    mappings = {name: groups.read_option("device", name) for name in config.devices}
    bindings, drivers = bindings_of(mappings), drivers_of(mappings, config.hardware)
    check_leader(config.action, bindings)
    tls = _tls(config)
    env = aerial_il.load_batch(
        config.robot.name,
        config.task.name,
        num_envs=1,
        num_threads=1,
        tier=config.tier.name,
        action=config.action,
        controller=config.controller.name,
    )
    operator = config.operator or getpass.getuser()
    try:
        logbook = Logbook(env, config.out, operator=operator, first_seed=config.seed)
    except BaseException:
        env.close()
        raise
    try:
        cockpit = Cockpit(env, bindings, logbook, time_scale=float(config.time_scale))
        site = Site(config.host, config.port, (config.size[0], config.size[1]), tls)
        opened = partial(_tell, open_page=config.open)
        asyncio.run(fly(env, cockpit, bindings, site, operator=operator, drivers=drivers, opened=opened))
    except KeyboardInterrupt:
        kept = logbook.counts()
        told = f"{kept['demos']} demonstrations, {kept['failures']} failures, {kept['trash']} in the trash"
        print(f"\n{config.out}: {told}.")
        if kept["demos"]:
            print(f"Next: {command_line(['validate', spelling.path('path', config.out)])}")
    finally:
        env.close()


def _tls(config: Config) -> ssl.SSLContext | None:
    """Return what the page is served with, and say its fingerprint, or what it means to do without."""
    from aerial_il.teleop.server import own_address, own_names
    from aerial_il.teleop.tls import fresh_certificate, own_certificate

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
        context, told = own_certificate(config.certificate, config.key_file)
    else:
        context, told = fresh_certificate([*LOOPBACK, own_address(), *own_names()])
        print("The browser will not know this certificate; compare its fingerprint before you go on.", flush=True)
    print(f"SHA-256 fingerprint: {told}", flush=True)
    return context


def _tell(server: Server, open_page: bool) -> None:
    """Say where the page is, and open it where there is a screen."""
    import socket
    import webbrowser

    from aerial_il.evaluation.films.window import has_screen

    print(f"Fly here: {server.url}", flush=True)
    if has_screen():
        if open_page:
            webbrowser.open(server.url)
    else:
        tunnel = f"ssh -N -L {server.port}:127.0.0.1:{server.port} {getpass.getuser()}@{socket.gethostname()}"
        print(f"From another machine, first: {tunnel}", flush=True)
    print("Ctrl-C ends the session; everything that is saved stays.", flush=True)
