"""A person on the page as the one whom an interactive algorithm learns from, from the first round to the last."""

import os
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, Self

from aerial_il.core.contracts import BatchEnv, Policy
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.teleop.flight import CAMERAS, Site, about
from aerial_il.teleop.input.mapping import Bindings
from aerial_il.teleop.session.cockpit import Cockpit
from aerial_il.teleop.session.helm import by_hand
from aerial_il.teleop.session.logbook import Logbook
from aerial_il.teleop.session.loop import Loop
from aerial_il.teleop.session.session import State
from aerial_il.teleop.web.host import PageHost
from aerial_il.teleop.web.server import Server

LEARNER = "learner"
WATCH_S = 0.1


class Costs(Protocol):
    """What a round's flights cost and brought, as far as a person is shown it."""

    @property
    def flights(self) -> int: ...

    @property
    def steps(self) -> int: ...

    @property
    def expert_steps(self) -> int: ...

    @property
    def solved_alone(self) -> int: ...


class PageOperator:
    """Serves the page from the first round to the last, while flying and while the learner learns.

    Args:
        env: one world. bindings: of the page's devices. site: where the page is served. operator: who flies.
        opened: called when the page is there.

    Attributes:
        server: of the page.
    """

    def __init__(
        self,
        env: BatchEnvironment,
        bindings: Bindings,
        site: Site,
        *,
        operator: str,
        opened: Callable[[Server], object],
    ) -> None:
        self._bindings, self._operator = bindings, operator
        texts = about(env, bindings, operator, site)
        place = {"host": site.host, "port": site.port, "tls": site.tls}
        self._page = PageHost(env.model, bindings, texts, cameras=CAMERAS, size=site.size, opened=opened, **place)
        self.server = self._page.server

    def __enter__(self) -> Self:
        self._page.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._page.__exit__()

    def notify(self, rounds: Sequence[Costs], message: str) -> None:
        """Show how the rounds so far went, and what happens now."""
        self.server.lesson = {"message": message, "rounds": [progress_of(costs) for costs in rounds]}

    def record(
        self,
        env: BatchEnv,
        learner: Policy,
        out: str | os.PathLike[str],
        *,
        seeds: range,
        tags: Mapping[str, Any],
    ) -> None:
        """Let the person watch, take over and keep flights until ``out`` holds one for each of ``seeds``."""
        world = by_hand(env)
        logbook = Logbook(
            world, str(out), operator=self._operator, first_seed=seeds.start, policy=LEARNER, settings=tags
        )
        cockpit = Cockpit(world, self._bindings, logbook, policy=learner)
        flight = Loop(cockpit, self._page.inbox, self._page.film.show, self.server.report)
        self.server.flight = flight
        flight.start()
        try:
            while logbook.seed < seeds.stop or logbook.waiting or cockpit.state is not State.IDLE:
                if (error := flight.error or self._page.film.error) is not None:
                    raise error
                time.sleep(WATCH_S)
        finally:
            self.server.flight = None
            flight.close()
        if flight.error is not None:
            raise flight.error


def progress_of(costs: Costs) -> dict[str, float]:
    """Return what a person is shown of a round: success without help, and their share of the frames, in %."""
    return {
        "alone": round(100 * costs.solved_alone / max(1, costs.flights)),
        "share": round(100 * costs.expert_steps / max(1, costs.steps), 1),
    }
