"""200 files of others with one thing wrong: each is refused, or says what is wrong, or reads as if nothing were."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from aerial_il.core.errors import DemoError
from aerial_il.data.dataset import Dataset, open_dataset
from aerial_il.data.formats.parts import hdf5_probe
from experiments.foreign.layouts import minari, robomimic
from tests.data.formats.recorded import last, lerobot, pair

CASES, EPISODES, STEPS = 40, 4, 12
Tree = dict[str, np.ndarray]  # what a file holds, by place


def path_of(episode: int, columns: int) -> np.ndarray:
    """Return what is seen in an episode, (T + 1, columns): it never stands still, and never comes back."""
    start = np.random.default_rng(episode).uniform(1, 2, columns)
    return start + np.linspace(0.5, 1.0, columns) * 0.1 * np.arange(STEPS + 1)[:, None]


def of_robomimic() -> Tree:
    tree = {}
    for episode in range(EPISODES):
        pos, vel = path_of(episode, 3), path_of(10 + episode, 2)
        tree |= {f"{episode}/obs/pos": pos[:-1], f"{episode}/obs/vel": vel[:-1], f"{episode}/actions": vel[1:]}
        tree |= {f"{episode}/next_obs/pos": pos[1:], f"{episode}/next_obs/vel": vel[1:]}
        tree |= {f"{episode}/rewards": last(STEPS).astype(float), f"{episode}/dones": last(STEPS)}
        tree[f"{episode}/states"] = pos[:-1]
    return tree


def of_minari() -> Tree:
    tree = {}
    for episode in range(EPISODES):
        ends, none = last(STEPS).astype(bool), np.zeros(STEPS, bool)
        tree |= {f"{episode}/observations": path_of(episode, 3), f"{episode}/actions": path_of(episode, 2)[1:]}
        tree |= {f"{episode}/terminations": ends, f"{episode}/truncations": none, f"{episode}/rewards": np.ones(STEPS)}
    return tree


def of_transitions() -> Tree:
    actions = np.concatenate([path_of(episode, 2)[1:] for episode in range(EPISODES)])
    ends = np.tile(last(STEPS), EPISODES).astype(bool)
    seen = pair(EPISODES, STEPS)
    tree = {"observations": seen["obs"], "next_observations": seen["next_obs"], "actions": actions}
    return tree | {"rewards": np.ones(len(actions)), "terminals": ends, "timeouts": np.zeros(len(actions), bool)}


def of_lerobot() -> Tree:
    frame = np.tile(np.arange(STEPS), EPISODES)
    numbers = {"observation.state": 2, "observation.velocity": 2, "action": 1}
    tree = {n: np.concatenate([path_of(e, w)[:-1] for e in range(EPISODES)]) for n, w in numbers.items()}
    tree |= {"timestamp": frame / 30, "frame_index": frame, "episode_index": np.repeat(np.arange(EPISODES), STEPS)}
    return tree | {"next.reward": np.ones(len(frame)), "next.done": frame == STEPS - 1}


def grouped(tree: Tree) -> list[dict[str, Any]]:
    """Return one mapping for each episode."""
    episodes: dict[str, dict[str, Any]] = {}
    for place, values in tree.items():
        episode, name, *inner = place.split("/")
        made = episodes.setdefault(episode, {})
        if inner:
            made.setdefault(name, {})[inner[0]] = values
        else:
            made[name] = values
    return list(episodes.values())


def as_robomimic(home: Path, tree: Tree) -> Path:
    return robomimic(home / "a.hdf5", *grouped(tree))


def as_minari(home: Path, tree: Tree) -> Path:
    return minari(home / "minari", *grouped(tree))


def as_npz(home: Path, tree: Tree) -> Path:
    np.savez(home / "a.npz", **tree)
    return home / "a.npz"


def as_d4rl(home: Path, tree: Tree) -> Path:
    with h5py.File(home / "d4rl.hdf5", "w") as file:
        for name, values in tree.items():
            file[name] = values
    return home / "d4rl.hdf5"


def as_lerobot(home: Path, tree: Tree) -> Path:
    def change(columns: dict[str, Any]) -> None:
        for name in [name for name in columns if name not in tree and name not in ("index", "task_index")]:
            del columns[name]
        columns |= tree
        rows = min(len(values) for values in columns.values())
        for name, values in columns.items():
            columns[name] = values[:rows]

    kinds = {"observation.velocity": ("float32", [2]), "next.reward": ("float32", [1]), "next.done": ("bool", [1])}
    extra = {name: (*kind, lambda t, n: t) for name, kind in kinds.items()}
    return lerobot(home / "lerobot", [STEPS] * EPISODES, extra=extra, change=change)


FORMATS: dict[str, tuple[Callable[[], Tree], Callable[[Path, Tree], Path]]] = {
    "robomimic": (of_robomimic, as_robomimic),
    "minari": (of_minari, as_minari),
    "npz": (of_transitions, as_npz),
    "d4rl": (of_transitions, as_d4rl),
    "lerobot": (of_lerobot, as_lerobot),
}
NUMBERS = ("obs", "state", "velocity", "action")  # in the names of what has a unit
TIMED = ("timestamp", "frame_index", "episode_index")


def mutations(place: str, values: np.ndarray, rng: np.random.Generator, form: str) -> Iterator[np.ndarray | None]:
    """Yield what may stand in a place instead of its values; None for nothing."""
    some = int(rng.integers(1, len(values) - 1))
    yield None
    yield np.array([f"{value}" for value in values.ravel()], "S").reshape(values.shape)
    yield values.astype("f4")
    if form != "lerobot":  # whose columns have one length, all of them
        yield values[:some]
        yield np.concatenate([values, values[-some:]])
        yield values[:0]
        yield values[..., None, None]
    if values.ndim == 2 and (form not in ("npz", "d4rl") or place != "actions"):  # a whole file of others is no oddity
        yield np.concatenate([values, values[:, :1]], 1)
        yield values[:, :1]
    floats = values.astype(float)
    for odd in (np.nan, np.inf):
        yield np.where(np.arange(values.size).reshape(values.shape) == some, odd, floats)
    if any(name in place for name in NUMBERS):
        part = slice(STEPS, 2 * STEPS) if "/" not in place else slice(None)
        for factor in (1000.0, 0.001):
            changed = floats.copy()
            changed[part] *= factor
            yield changed
    if ("obs" in place and form in ("robomimic", "npz", "d4rl")) or place in TIMED:
        order = np.arange(len(values))
        order[[some - 1, some]] = order[[some, some - 1]]
        yield values[order]
        yield np.concatenate([values[:some], values[some - 1 : -1]])
    if "termina" in place or "done" in place or "timeouts" in place:
        yield np.roll(values, 1 if form == "minari" else some)


class Sound(dict[Any, int]):
    """Says of every file that the process which looked at it came back."""

    def get(self, *_: Any) -> int:
        return 0


@pytest.fixture
def mutated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Look at no file in a process first: these are whole, only what is in them is odd."""
    monkeypatch.setattr(hdf5_probe, "look_at", lambda _: None)
    monkeypatch.setattr(hdf5_probe, "ended", Sound())


def episodes_of(dataset: Dataset) -> list[tuple[np.ndarray, ...]]:
    held = lambda e: (*(e.obs[name] for name in sorted(e.obs)), e.actions, e.rewards)  # noqa: E731
    return [(*held(episode), np.array([episode.is_terminal, episode.success])) for episode in dataset]


def equal(ours: list[tuple[np.ndarray, ...]], theirs: list[tuple[np.ndarray, ...]]) -> bool:
    if len(ours) != len(theirs):
        return False
    pairs = [(a, b) for one, other in zip(ours, theirs, strict=True) for a, b in zip(one, other, strict=False)]
    same = all(len(one) == len(other) for one, other in zip(ours, theirs, strict=True))
    return same and all(a.shape == b.shape and np.allclose(a, b, rtol=1e-5, atol=1e-6) for a, b in pairs)


@pytest.mark.usefixtures("mutated")
@pytest.mark.parametrize("form", FORMATS)
def test_none_passes_silently_and_none_breaks(form: str, tmp_path: Path) -> None:
    make, write = FORMATS[form]
    (tmp_path / "sound").mkdir()
    sound = open_dataset(write(tmp_path / "sound", make()))
    whole, assumed = episodes_of(sound), sound.survey.assumed
    assert len(whole) == EPISODES
    assert not sound.survey.notes
    outcomes = {"refused": 0, "told": 0, "harmless": 0}
    for case in range(CASES):
        rng, tree = np.random.default_rng([case, len(form)]), make()
        place = str(rng.choice(sorted(tree)))
        odd = [*mutations(place, tree[place], rng, form)]
        number = int(rng.integers(len(odd)))
        if odd[number] is None:
            del tree[place]
        else:
            tree[place] = odd[number]
        (home := tmp_path / str(case)).mkdir()
        file = write(home, tree)
        try:
            dataset = open_dataset(file)
            read = episodes_of(dataset)
        except DemoError:
            outcomes["refused"] += 1
            continue
        problems = [str(error) for _, error in dataset.problems() if error is not None]
        if equal(read, whole):
            outcomes["harmless"] += 1
        else:
            said = [*problems, *dataset.survey.notes.values(), *(t for t in dataset.survey.assumed if t not in assumed)]
            assert said, f"{form}, case {case}: {place}, mutation {number} of {len(odd)}: {odd[number]!r:.300}"
            outcomes["told"] += 1
    assert outcomes["harmless"] > 0, outcomes
    assert outcomes["refused"] + outcomes["told"] > CASES // 2, outcomes
