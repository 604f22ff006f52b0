"""The gate: what cannot be used is refused by name, whatever format it lies in; what is merely left unsaid is not."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerial_il.core.errors import DemoError
from aerial_il.data.check import Gate, require_whole
from aerial_il.data.episode import Episode
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.source import Later, Raw, Source, Wanted
from aerial_il.data.survey import Survey, surveyed

STEPS = 6


def raw(**changed: Any) -> Raw:
    rng = np.random.default_rng(0)
    obs = {"position": rng.normal(size=(STEPS, 3)), "camera": np.zeros((STEPS, 4, 5, 3), np.uint8)}
    return replace(Raw(obs=obs, actions=rng.normal(size=(STEPS, 2))), **changed)


def source(*demonstrations: Raw, **changed: Any) -> Source:
    each = {f"demo_{i}": lambda demo=demo: demo for i, demo in enumerate(demonstrations)}
    return Source(path=Path("data.xyz"), kind="a test", raw=each, **changed)


def survey(*demonstrations: Raw, wanted: Wanted = Wanted(cameras=True), **changed: Any) -> Survey:  # noqa: B008
    return surveyed(source(*demonstrations, **changed), wanted)


def read(*demonstrations: Raw, **answers: Any) -> list[Episode]:
    changed = {name: answers.pop(name) for name in ("spec", "borders", "control_dt_s") if name in answers}
    wanted = Wanted(cameras=True, strict=True, **answers)
    return [load() for load in survey(*demonstrations, wanted=wanted, **changed).loaders.values()]


def obs(**changed: Any) -> Mapping[str, Any]:
    return {**raw().obs, **changed}


def with_nan(values: np.ndarray, *where: int) -> np.ndarray:
    values = values.astype(float)
    values[where] = np.nan
    return values


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"actions": np.zeros((0, 2))}, "demo_1 has no steps"),
        ({"actions": np.zeros(STEPS)}, r"demo_1 has actions of another shape.*expected \(2,\), got \(1,\)"),
        ({"actions": np.zeros((STEPS, 2, 1, 1))}, "demo_1 has actions that are not vectors of numbers"),
        ({"actions": np.zeros((STEPS, 2), int)}, "not vectors of numbers.*Discrete"),
        ({"actions": np.zeros((STEPS, 3))}, r"demo_1 has actions of another shape.*expected \(2,\), got \(3,\)"),
        ({"actions": with_nan(np.zeros((STEPS, 2)), 4, 1)}, r"not finite. \[step 4, field actions\[1\]\]"),
        ({"obs": obs(position=np.zeros((STEPS - 3, 3)))}, "position of another length.*expected 6 or 7 rows, got 3"),
        ({"obs": obs(position=np.zeros((STEPS + 2, 3)))}, "position of another length"),
        ({"obs": obs(position=np.zeros((STEPS, 4)))}, r"position of another shape.*expected \(3,\), got \(4,\)"),
        ({"obs": obs(position=with_nan(np.zeros((STEPS, 3)), 2, 0))}, r"not finite. \[step 2, field position\[0\]\]"),
        ({"obs": obs(position=np.array(["a"] * STEPS))}, "position that are not rows of numbers"),
        ({"rewards": np.zeros(STEPS - 1)}, "rewards of another length.*expected 6 rows, got 5"),
        ({"rewards": np.zeros((STEPS, 2))}, "rewards that are not one number a step"),
        ({"rewards": with_nan(np.zeros(STEPS), 3)}, r"not finite. \[step 3, field rewards\]"),
        ({"terminated": np.zeros(1, bool)}, "terminated of another length"),
        ({"states": np.zeros((2, 4))}, "states of another length"),
    ],
)
def test_what_cannot_be_used_is_named(changed: dict[str, Any], says: str) -> None:
    with pytest.raises(DemoError, match=rf"^data\.xyz: .*{says}"):
        read(raw(), raw(**changed))


def test_pictures_are_not_read_before_their_episode_is() -> None:
    seen: list[str] = []

    def picture(name: str) -> Later:
        def load(rows: slice) -> np.ndarray:
            seen.append(name)
            return np.zeros((STEPS, 4, 5, 3), np.uint8)[rows]

        return Later((STEPS, 4, 5, 3), np.dtype(np.uint8), load)

    loaders = survey(raw(obs=obs(camera=picture("a"))), raw(obs=obs(camera=picture("b")))).loaders
    assert seen == []
    assert loaders["demo_1"]().obs["camera"].shape == (STEPS + 1, 4, 5, 3)
    assert seen == ["b"]


@pytest.mark.parametrize(("said", "taken"), [((None, None), (True, True)), ((True, None), (True, False))])
def test_silence_is_failure_only_where_others_are_judged(said: tuple, taken: tuple) -> None:
    assert tuple(episode.success for episode in read(*(raw(success=each) for each in said))) == taken


def test_transitions_are_cut_where_an_episode_ended() -> None:
    over, position = np.array([0, 0, 1, 0, 0, 0], bool), np.arange(STEPS)[:, None] * [0.1, 0.2, 0.3]
    whole = raw(
        obs={"position": position}, terminated=over, next_obs={"position": position + np.array([0.1, 0.2, 0.3])}
    )
    first, second = read(whole, borders=False)
    assert (len(first), len(second), first.uid, second.uid) == (3, 3, "demo_0_000000", "demo_0_000001")
    assert (first.is_terminal, second.is_terminal) == (True, False)
    np.testing.assert_array_equal(first.obs["position"][-1], whole.next_obs["position"][2])
    with pytest.raises(DemoError, match=r"next position of another length than its actions\. expected 6 rows, got 7"):
        read(replace(whole, next_obs={"position": np.zeros((STEPS + 1, 3))}), borders=False)


def test_a_recorded_specification_is_held_against_what_is_there() -> None:
    (episode,) = read(raw())
    assert len(read(raw(), spec=episode.spec)) == 1
    with pytest.raises(DemoError, match="demo_0 has extra, which its specification lacks"):
        read(raw(obs=obs(extra=np.zeros(STEPS))), spec=episode.spec)
    with pytest.raises(DemoError, match="demo_0 lacks position"):
        read(raw(obs={"camera": raw().obs["camera"]}), spec=episode.spec)
    with pytest.raises(DemoError, match="position of another shape"):
        read(raw(obs=obs(position=np.zeros((STEPS, 4)))), spec=episode.spec)


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        ("rewards", lambda values: values[:-1], "rewards of another length"),
        ("states", lambda values: values[1:], "states of another length"),
        ("actions", lambda values: values[:, :1], "actions of another shape"),
        ("ctrl", lambda values: with_nan(values, 5, 1), r"topic /step, step 5, field ctrl\[1\]"),
        ("expert_actions", lambda values: with_nan(values, 2, 0), r"step 2, field expert_action\[0\]"),
    ],
)
def test_recorded_episodes_pass_it_too(demo: Path, name: str, change: Callable, says: str) -> None:
    episode = read_episode(demo)
    with pytest.raises(DemoError, match=says):
        require_whole(Gate(demo), replace(episode, **{name: change(getattr(episode, name))}))
