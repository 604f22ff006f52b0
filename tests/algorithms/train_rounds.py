"""Train interactively on the corridor."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.dagger import DAgger
from aerial_il.algorithms.dart import DART
from aerial_il.algorithms.interactive.gates.coin import CoinGate
from aerial_il.algorithms.interactive.gates.thrifty import ThriftyGate
from aerial_il.collection.collect import collect
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode
from aerial_il.policies.mlp import MLP
from tests.algorithms.corridor import Corridor, Pilot, success_rate

POLICY = MLP(hidden=(32,), chunk=1, anchor=None, masked_fields=(), ensemble=None)
BC = BC(
    steps=300,
    batch_size=64,
    lr=3e-3,
    warmup_steps=10,
    ema=0.98,
    validation=0.0,
    validate_every=0,
    cadence=replace(BC.cadence, checkpoint_every=40),
)
DAGGER = DAgger(rounds=3, episodes=5, gate=CoinGate(), training=BC, between_steps=100)
THRIFTY = DAgger(
    rounds=2,
    episodes=5,
    gate=ThriftyGate(ensemble=2, alone=5, least=3),
    training=BC,
    between_steps=100,
    warm_start=False,
)
DART = DART(rounds=2, episodes=5, training=BC, between_steps=100)


def demonstrations(folder: Path, count: int = 3) -> list[Episode]:
    collect(Corridor(count), Pilot(), range(count), folder, progress=False)
    return list(open_dataset(folder))


def flights_of(run: Path, number: int) -> list[Episode]:
    return list(open_dataset(run / "rounds" / f"{number:03d}" / "flights", failures=True))


def evaluate(policy: Any, round_number: int) -> dict[str, float]:
    return {"success": success_rate(policy, episodes=20, seed=10_000)}


def train(run: Path, settings: Any = DAGGER, demos: list[Episode] | None = None, **changes: Any) -> Any:
    options: dict[str, Any] = {
        "run": run,
        "env": Corridor(5),
        "expert": Pilot(),
        "collect": collect,
        "evaluate": evaluate,
        "seed": 1,
        "progress": False,
    }
    demos = demos or demonstrations(run.with_name(f"{run.name}.demos"))
    return settings.train(demos, POLICY, **(options | changes))
