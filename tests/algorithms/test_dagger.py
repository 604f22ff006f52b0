"""Dagger learning: what it costs, what it brings, what of it is learned from, and that a kill costs nothing."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from aerial_il.algorithms.interactive.gates.coin import CoinGate
from aerial_il.algorithms.interactive.gates.human import Corrector
from aerial_il.algorithms.interactive.gates.thrifty import ThriftyGate
from aerial_il.algorithms.interactive.rounds import demonstration_weights
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.collection.collect import collect
from aerial_il.core import checkpoint
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from tests.algorithms import train_rounds
from tests.algorithms.corridor import SPEC, Corridor, Pilot, success_rate
from tests.algorithms.train_rounds import BC, DAGGER, DART, POLICY, demonstrations, flights_of, train

EPISODES = 100


@pytest.fixture(scope="module")
def demos(tmp_path_factory: pytest.TempPathFactory) -> list[Episode]:
    return demonstrations(tmp_path_factory.mktemp("demos"))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, demos: list[Episode]) -> Path:
    """A run that nothing disturbed."""
    run = tmp_path_factory.mktemp("whole") / "run"
    train(run, DAGGER, demos)
    return run


# --- what it brings


def test_it_learns_to_come_back_where_cloning_drifts_off(tmp_path: Path, demos: list[Episode], whole: Path) -> None:
    """On unseen seeds, far beyond chance, and although cloning gets as many demonstrations as there were episodes."""
    dagger = success_rate(load_policy(whole), episodes=EPISODES, seed=20_000)
    episodes = int(read_metrics(whole)[-1]["total/episodes"])
    shown = demonstrations(tmp_path / "more", episodes)
    cloned = BC.train(shown, POLICY, run=tmp_path / "bc", seed=1, progress=False)
    bc = success_rate(cloned, episodes=EPISODES, seed=20_000)
    table = [[round(EPISODES * rate), round(EPISODES * (1 - rate))] for rate in (dagger, bc)]
    assert stats.fisher_exact(table, alternative="greater").pvalue < 1e-4, (dagger, bc)


def test_a_round_tells_what_it_cost(whole: Path, demos: list[Episode]) -> None:
    rows = read_metrics(whole)
    assert [row["step"] for row in rows] == [0, 1, 2, 3]
    assert rows[0]["queries"] == 0
    assert rows[0]["total/labelled_steps"] == sum(map(len, demos))
    for number, row in enumerate(rows[1:], start=1):
        flights = flights_of(whole, number)
        assert row["flights"] == len(flights) == DAGGER.episodes
        assert row["queries"] == row["flight_steps"] == sum(map(len, flights)), "every state is labelled"
        assert row["beta"] == pytest.approx(0.7**number)
        assert row["expert_steps"] == sum(int(f.is_intervention.sum()) for f in flights)
    assert rows[-1]["total/queries"] == sum(row["queries"] for row in rows)
    assert rows[-1]["total/episodes"] == len(demos) + 3 * DAGGER.episodes
    assert all("evaluate/success" in row for row in rows)
    assert load_policy(whole).origin["total/queries"] == rows[-1]["total/queries"]


def test_every_round_but_the_first_goes_on_from_the_one_before(whole: Path) -> None:
    learned = [load_policy(whole / "rounds" / f"{number:03d}" / "training") for number in range(DAGGER.rounds + 1)]
    started = [policy.origin.get("initial") for policy in learned]
    before = [checkpoint.digest(checkpoint.Checkpoint(policy.to_checkpoint().arrays)) for policy in learned]
    assert started == [None, *before[:-1]]


def test_it_ends_when_its_rounds_no_longer_gain_wherever_it_was_killed(tmp_path: Path, demos: list[Episode]) -> None:
    rates, settings = [0.2, 0.6, 0.5, 0.6, 0.9], replace(DAGGER, rounds=4, stale_rounds=2)

    def judged(_: Any, number: int) -> dict[str, float]:
        return {"success": rates[number]}

    for _ in range(2):
        policy = train(tmp_path / "run", settings, demos, evaluate=judged)
        assert policy.origin["round"] == 3
        assert not (tmp_path / "run" / "rounds" / "004").exists()
        shutil.rmtree(tmp_path / "run" / "policy")
    with pytest.raises(InvalidValueError, match="stale_rounds is 2; it needs evaluations"):
        replace(settings, evaluate_every=0)


def test_executed_and_expert_actions_are_both_kept(whole: Path) -> None:
    for flight in flights_of(whole, 2):
        expert, held = Pilot().act(flight.obs)[: len(flight)], flight.is_intervention
        np.testing.assert_allclose(flight.expert_actions, expert, atol=1e-12)
        np.testing.assert_allclose(flight.actions[held], expert[held], atol=1e-12)
        assert np.abs(flight.actions[~held] - expert[~held]).max() > 1e-3, "the learner flew its own way"


def test_the_union_of_all_rounds_is_an_ordinary_dataset(whole: Path, demos: list[Episode], tmp_path: Path) -> None:
    result = list(open_dataset(whole / "dataset", failures=True))
    tags = [episode.provenance["settings"].get("round", 0) for episode in result]
    assert {number: tags.count(number) for number in set(tags)} == {0: len(demos), 1: 5, 2: 5, 3: 5}
    first = next(episode for episode in result if episode.uid == demos[0].uid)
    np.testing.assert_array_equal(first.expert_actions, demos[0].expert_actions)
    np.testing.assert_array_equal(first.obs["error"], demos[0].obs["error"])
    BC.train(open_dataset(whole / "dataset"), POLICY, run=tmp_path / "plain", progress=False)


# --- what may go wrong


@pytest.mark.parametrize("number", [0, 1, 3])
def test_interrupted_while_it_flies_or_is_judged_it_goes_on(
    tmp_path: Path, whole: Path, demos: list[Episode], number: int
) -> None:
    def broken(env: Any, policy: Any, seeds: Any, out: Any, **options: Any) -> None:
        if options["settings"]["round"] == number:
            collect(env, policy, list(seeds)[:2], out, **options)
            raise KeyboardInterrupt
        collect(env, policy, seeds, out, **options)

    def judge(policy: Any, step: int) -> dict[str, float]:
        if step == 0:
            raise KeyboardInterrupt
        return train_rounds.evaluate(policy, step)

    with pytest.raises(KeyboardInterrupt):
        train(tmp_path / "run", DAGGER, demos, **({"collect": broken} if number else {"evaluate": judge}))
    train(tmp_path / "run", DAGGER, demos)
    same_end(tmp_path / "run", whole)


def untimed(run: Path) -> list[dict[str, float]]:
    """Return a run's metrics without how long each round took."""
    return [{name: value for name, value in row.items() if name != "elapsed_s"} for row in read_metrics(run)]


def same_end(run: Path, whole: Path) -> None:
    assert (run / "policy" / checkpoint.ARRAYS).read_bytes() == (whole / "policy" / checkpoint.ARRAYS).read_bytes()
    assert untimed(run) == untimed(whole)
    names = [{path.name for path in (r / "dataset").rglob("*.mcap")} for r in (run, whole)]
    assert names[0] == names[1]


def test_a_finished_run_is_not_done_again(whole: Path, demos: list[Episode]) -> None:
    before = {path: path.stat().st_mtime_ns for path in (whole / "rounds").rglob("*") if path.is_file()}
    expert = Pilot()
    train(whole, DAGGER, demos, expert=expert)
    assert expert.shown == 0
    assert {path: path.stat().st_mtime_ns for path in before} == before


def test_what_does_not_fit_together_is_refused(whole: Path, demos: list[Episode], tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match=r"settings\.rounds: 3 -> 4"):
        train(whole, replace(DAGGER, rounds=4), demos)
    with pytest.raises(InvalidValueError, match="asks an expert, and there is none"):
        train(tmp_path / "a", DAGGER, demos, expert=None)
    other = Corridor(5)
    other.spec = replace(SPEC, robot="crane")
    with pytest.raises(InvalidValueError, match="another environment: robot: 'point' != 'crane'"):
        train(tmp_path / "b", DAGGER, demos, env=other)


@pytest.mark.parametrize(
    ("kind", "wrong"),
    [
        (CoinGate, {"beta": "cubic"}),
        (CoinGate, {"decay": 1.5}),
        (CoinGate, {"over": 0}),
        (CoinGate, {"hold": 0}),
        (ThriftyGate, {"ensemble": 1}),
        (ThriftyGate, {"alarms": 0.0}),
        (ThriftyGate, {"agreement": 0.0}),
        (ThriftyGate, {"novelty": False, "risk": False}),
        (Corrector, {"take": 0.1, "give": 0.2}),
        (type(DAGGER), {"rounds": 0}),
        (type(DAGGER), {"training": replace(BC, cadence=replace(BC.cadence, evaluate_every=10))}),
        (type(DART), {"scale": 0.0}),
    ],
)
def test_impossible_settings_are_refused(kind: Any, wrong: dict[str, Any]) -> None:
    with pytest.raises(InvalidValueError, match=next(iter(wrong))):
        kind(**wrong)


# --- what of it is learned from


def test_a_learner_that_hangs_is_not_waited_for(tmp_path: Path, demos: list[Episode]) -> None:
    """Its flights are cut off after a multiple of the longest demonstration, and count as failures."""
    longest = max(map(len, demos))
    hasty = replace(DAGGER, rounds=1, patience=0.25, gate=CoinGate(beta="zero"))
    train(tmp_path / "hasty", hasty, demos)
    flights = flights_of(tmp_path / "hasty", 1)
    assert [len(f) for f in flights] == [-(-longest // 4)] * len(flights)
    assert all(f.truncated[-1] and not f.success for f in flights)
    train(tmp_path / "patient", replace(hasty, patience=0.0), demos)
    assert max(map(len, flights_of(tmp_path / "patient", 1))) > longest // 4


def test_demonstrations_keep_their_share_of_the_minibatches(whole: Path, demos: list[Episode]) -> None:
    flown = [flight for number in (1, 2, 3) for flight in flights_of(whole, number)]
    dataset, steps = [*demos, *flown], np.array([len(e) for e in [*demos, *flown]])
    shown = steps[: len(demos)].sum() / steps.sum()
    for share in (0.0, 0.5 * shown, 0.5, 0.9):
        weights = demonstration_weights(demos, flown, share)
        if share <= shown:
            assert weights is None, "they have more than that: all steps are visited alike"
            continue
        divided = BC.divide(dataset, POLICY, seed=0, failures=True, weights=weights)
        visited = divided.weights * steps
        assert visited[: len(demos)].sum() / visited.sum() == pytest.approx(share)


def test_only_labelled_steps_of_a_flight_count_for_that_share(demos: list[Episode]) -> None:
    flight = demos[0]
    rarely = np.where(np.arange(len(flight))[:, None] < len(flight) // 4, flight.actions, np.nan)
    flown = [replace(flight, expert_actions=rarely)] * (8 * len(demos))
    weights = demonstration_weights(demos, flown, 0.5)
    assert weights is not None
    divided = BC.divide([*demos, *flown], POLICY, seed=0, failures=True, weights=weights)
    windows = np.array([*map(len, demos), *[len(flight) // 4] * len(flown)])
    visited = divided.weights * windows
    assert visited[: len(demos)].sum() / visited.sum() == pytest.approx(0.5)


def test_weights_that_do_not_fit_the_episodes_are_refused(demos: list[Episode]) -> None:
    with pytest.raises(InvalidValueError, match=f"{len(demos)} demonstrations .* 1 weights"):
        BC.divide(demos, POLICY, seed=0, weights=[1.0])
