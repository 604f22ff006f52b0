"""Contrastive preference learning moves a clone of good and bad flights to what is preferred, and nowhere else."""

from dataclasses import replace
from math import exp, log
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.cpl import CPL, contrast, log_likelihood
from aerial_il.algorithms.supervised.segment_pairs import SegmentPairs
from aerial_il.core.checkpoint import ARRAYS
from aerial_il.core.errors import DemoError, InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.data.preferences.file import PreferenceFile
from aerial_il.data.preferences.pairs import Preference, Segment, draw_pairs
from aerial_il.data.windows import Windows
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.diffusion import Diffusion
from aerial_il.policies.gmm import GMM
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicySettings, state_of
from aerial_il.policies.recurrent import Recurrent
from tests.algorithms.drift import Drift, guide
from tests.algorithms.stateless_batch import episode_of, fly

FLIGHTS, STEPS, LENGTH, AMISS = 30, 12, 5, 0.3
POLICY = MLP(hidden=(32, 32), chunk=1, ensemble=None, anchor=None, loss="l2")
CLONE = BC(steps=300, batch_size=64, lr=3e-3, warmup_steps=10, ema=0.9, validation=0.0, validate_every=0)
SMALL = CPL(cloning=CLONE, pairs=400, length=LENGTH, looked_at=5, alpha=0.5, steps=300, batch_size=32, lr=1e-3, ema=0.9)


def flown(first: int, *, amiss: float) -> list[Episode]:
    """Fly to the goal, or ``amiss`` of it, and call the latter failures."""
    env = Drift(FLIGHTS)
    seen, actions = [env.reset(first)], []
    for _ in range(STEPS):
        goal = {**seen[-1], "goal": seen[-1]["goal"] + amiss}
        result = env.step(guide(goal))
        seen.append(result.obs)
        actions.append(result.info["executed_action"])
    shown = [{k: np.stack([o[k][i] for o in seen]) for k in seen[0]} for i in range(FLIGHTS)]
    found = [episode_of(env.spec, first + i, obs, np.stack(actions)[:, i]) for i, obs in enumerate(shown)]
    return [replace(episode, success=amiss == 0.0) for episode in found]


@pytest.fixture(scope="module")
def mixed() -> list[Episode]:
    return [*flown(0, amiss=0.0), *flown(FLIGHTS, amiss=AMISS)]


@pytest.fixture(scope="module")
def better(mixed: list[Episode]) -> list[Preference]:
    """Pairs of which the flight to the goal is preferred, and equal where both were alike."""
    wins = {episode.uid: episode.success for episode in mixed}
    pairs = draw_pairs({e.uid: len(e) for e in mixed}, 400, length=LENGTH, seed=0)
    answers = ("equal", "left", "right")
    return [Preference(a, b, answers[int(wins[a.uid]) - int(wins[b.uid])], "hand") for a, b in pairs]


def written(path: Path, preferences: list[Preference], episodes: list[Episode]) -> Path:
    with PreferenceFile(path, {episode.uid: len(episode) for episode in episodes}) as file:
        for preference in preferences:
            file.add(preference)
    return path


def trained(run: Path, episodes: list[Episode], policy: PolicySettings = POLICY, **settings: Any) -> ChunkPolicy:
    return replace(SMALL, **settings).train(episodes, policy, run=run, seed=3, progress=False)


def missed(policy: ChunkPolicy) -> float:
    """Return how far from their goals unseen flights end."""
    *_, last = fly(Drift(100), policy, 10_000)
    return float(np.abs(last.obs["position"] - last.obs["goal"]).mean())


@pytest.fixture(scope="module")
def clone(mixed: list[Episode], tmp_path_factory: pytest.TempPathFactory) -> ChunkPolicy:
    run = tmp_path_factory.mktemp("clone") / "run"
    return CLONE.train(mixed, POLICY, run=run, seed=3, failures=True, progress=False)


def test_preferred_actions_are_flown(
    tmp_path: Path, mixed: list[Episode], better: list[Preference], clone: ChunkPolicy
) -> None:
    file = written(tmp_path / "said.jsonl", better, mixed)
    learned = trained(tmp_path / "run", mixed, preferences=str(file))
    assert 0.08 < missed(clone) < 0.25, "half way between both kinds of flights"
    assert missed(learned) < 0.5 * missed(clone)


def test_labels_turned_round_lead_astray(
    tmp_path: Path, mixed: list[Episode], better: list[Preference], clone: ChunkPolicy
) -> None:
    turned = [Preference(p.right, p.left, p.preferred, p.by) for p in better]
    file = written(tmp_path / "said.jsonl", turned, mixed)
    assert missed(trained(tmp_path / "run", mixed, preferences=str(file))) > 1.3 * missed(clone)


def test_the_script_needs_no_file_and_no_reward(tmp_path: Path, mixed: list[Episode], clone: ChunkPolicy) -> None:
    assert all((episode.rewards == 0.0).all() for episode in mixed)
    assert missed(trained(tmp_path / "run", mixed)) < 0.7 * missed(clone)


def test_a_file_of_the_script_teaches_what_it_does(tmp_path: Path, mixed: list[Episode]) -> None:
    brief = {"steps": 10, "cloning": replace(CLONE, steps=10)}
    pairs = draw_pairs({e.uid: len(e) for e in mixed}, SMALL.pairs, length=LENGTH, seed=SMALL.judge.seed)
    file = written(tmp_path / "said.jsonl", list(SMALL.judge.judge(mixed, pairs)), mixed)
    trained(tmp_path / "judged", mixed, **brief)
    trained(tmp_path / "read", mixed, preferences=str(file), **brief)
    judged, read = ((tmp_path / run / "policy" / ARRAYS).read_bytes() for run in ("judged", "read"))
    assert judged == read


def test_a_run_with_other_answers_is_another_run(tmp_path: Path, mixed: list[Episode]) -> None:
    brief = {"steps": 10, "cloning": replace(CLONE, steps=10), "cadence": replace(CPL.cadence, checkpoint_every=5)}
    trained(tmp_path / "run", mixed, **brief)
    with pytest.raises(InvalidValueError, match="holds another run"):
        trained(tmp_path / "run", mixed, judge=replace(SMALL.judge, flipped=0.5), **brief)


FREE = {"anchor": None, "chunk": 4}
DRAWING = (Diffusion(**FREE), GMM(**FREE), Categorical(), Recurrent(head="gmm", **FREE))


@pytest.mark.parametrize("policy", DRAWING, ids=lambda policy: policy.name)
def test_policies_that_draw_are_refused(tmp_path: Path, mixed: list[Episode], policy: PolicySettings) -> None:
    with pytest.raises(InvalidValueError, match=rf"policy={policy.name} draws .* trains policy=mlp"):
        trained(tmp_path / "run", mixed, policy)
    assert not (tmp_path / "run").exists(), "nothing was cloned first"


def test_files_about_others_or_of_nothing_are_refused(tmp_path: Path, mixed: list[Episode]) -> None:
    other = [replace(episode, uid=f"other-{episode.uid}") for episode in mixed]
    pair = Segment(other[0].uid, 0, 5), Segment(other[1].uid, 0, 5)
    file = written(tmp_path / "said.jsonl", [Preference(*pair, "left", "hand")], other)
    with pytest.raises(DemoError, match=r"line 2 .*the dataset has no episode other-demo-0"):
        trained(tmp_path / "run", mixed, preferences=str(file))
    empty = written(tmp_path / "empty.jsonl", [], mixed)
    with pytest.raises(InvalidValueError, match="no preference yet"):
        trained(tmp_path / "run", mixed, preferences=str(empty))


def test_relabelled_flights_by_hand_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="as recorded"):
        CPL(cloning=replace(CLONE, waypoints=replace(CLONE.waypoints, lookahead_s=0.5)))


def test_the_loss_is_that_of_the_paper() -> None:
    better, worse, scale, bias = -0.4, -0.1, 2.0, 0.5
    expected = -log(exp(scale * better) / (exp(scale * better) + exp(scale * bias * worse)))
    found = contrast(torch.tensor([better]), torch.tensor([worse]), scale=scale, bias=bias)
    assert found.item() == pytest.approx(expected)


def test_likelihood_ends_with_the_episode() -> None:
    mean, actions = torch.zeros(1, 3, 2), torch.tensor([[[1.0, 2.0], [0.0, 1.0], [9.0, 9.0]]])
    assert log_likelihood(mean, actions, torch.tensor([[1.0, 1.0, 0.0]])).item() == pytest.approx(-3.0)


def test_pairs_hold_the_preferred_segment_first(mixed: list[Episode], clone: ChunkPolicy) -> None:
    left, right = Segment(mixed[0].uid, 2, 4), Segment(mixed[1].uid, 5, 4)
    names = clone.interface.layout.names
    windows = Windows(mixed, names, target="executed_actions", successes_only=False)

    def pairs_of(preferred: Any) -> SegmentPairs:
        said = [Preference(left, right, preferred, "hand")]
        return SegmentPairs(mixed, windows, said, clone.interface, steps=4, device="cpu")

    for preferred, first in (("left", left), ("right", right)):
        pairs = pairs_of(preferred)
        obs, actions, valid = pairs.gather(np.array([0]))
        steps = first.first + np.arange(4)
        flight = next(episode for episode in mixed if episode.uid == first.uid)
        shown = clone.interface.encode_obs(flight.flat_obs(names)[steps, None])
        np.testing.assert_allclose(state_of(obs)[:4], shown, rtol=1e-5)
        assert len(pairs) == 1
        assert len(actions) == len(valid) == 8
        better, worse = pairs.by_segment(torch.arange(8.0))
        assert (better.item(), worse.item()) == (1.5, 5.5)
    equal = pairs_of("equal")
    assert len(equal) == 2
    np.testing.assert_array_equal(equal.weights, [0.5, 0.5])
