"""A search: its space as Hydra writes it, trials that are stopped early, and the same trials after a kill."""

import fcntl
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from aerial_il.cli import words
from aerial_il.cli.commands import find
from aerial_il.cli.compose import space
from aerial_il.cli.main import main
from aerial_il.core.errors import InvalidValueError

optuna = pytest.importorskip("optuna")
from aerial_il.cli.sweepers import optuna as sweeper  # noqa: E402
from aerial_il.cli.sweepers.optuna import JOURNAL, LOCK, STUDY, Optuna, distribution  # noqa: E402

SPACE = ["algorithm.lr=tag(log,interval(0.000001,0.03))", "policy.chunk=choice(5,10)"]
WORDS = ["train", "-m", "dataset=demos", "experiment=quick", "algorithm.steps=200", "policy.hidden=[16]", *SPACE]
WORDS += [
    "algorithm.cadence.log_every=20",
    "algorithm.validation=0",
    "run=search",
    "sweeper=optuna",
    "sweeper.trials=6",
]
WORDS += ["sweeper.metric=loss", "sweeper.minimize=true", "sweeper.startup=2"]


def swept(*typed: str) -> tuple[dict[str, Any], list[str]]:
    command = find("train")
    return space(command, words.read(command, ["-m", *typed]).overrides)


def test_a_space_is_read_as_hydra_writes_it() -> None:
    typed = [*SPACE, "algorithm.steps=range(100,500,100)", "algorithm.patience=1,2", "dataset=d", "run=r", "seed=3"]
    ways, fixed = swept(*typed)
    kinds = optuna.distributions
    assert {key: distribution(key, sweep) for key, sweep in ways.items()} == {
        "algorithm.lr": kinds.FloatDistribution(1e-6, 0.03, log=True),
        "policy.chunk": kinds.CategoricalDistribution([5, 10]),
        "algorithm.steps": kinds.IntDistribution(100, 400, step=100),
        "algorithm.patience": kinds.CategoricalDistribution([1, 2]),
    }
    assert fixed == ["dataset.path=d", "seed=3"]
    rates = {"0.5,3.5,1": (0.5, 2.5, 1.0), "0.1,0.9,0.2": (0.1, 0.7, 0.2)}
    for typed, (low, high, step) in rates.items():
        found = distribution("algorithm.lr", swept(f"algorithm.lr=range({typed})")[0]["algorithm.lr"])
        assert (found.low, found.high, found.step) == pytest.approx((low, high, step))
    for empty in ("50,5,-5", "5,5,1"):
        with pytest.raises(InvalidValueError, match=f"seed: range.{empty}. is empty; a search goes up"):
            distribution("seed", swept(f"seed=range({empty})")[0]["seed"])
    with pytest.raises(InvalidValueError, match="interval"):
        distribution("seed", swept("seed=glob(*)")[0]["seed"])
    with pytest.raises(InvalidValueError, match="nothing to search"):
        swept("seed=3")


def test_any_seed_draws() -> None:
    assert Optuna(seed=50_000).sampler(3) is not None


def test_a_search_needs_a_sweep(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "run=x", "sweeper=optuna"]) == 2
    assert "add -m" in capsys.readouterr().err


def test_a_folder_holds_one_search_and_one_process_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> Any:
        raise InvalidValueError("no room")

    monkeypatch.setattr(sweeper, "start", refused)
    ways, _ = swept("algorithm.lr=interval(0.1,0.2)", "run=r")
    folder, other = str(tmp_path / "bob's"), {"algorithm.lr": swept("algorithm.lr=0.1,0.2", "run=r")[0]["algorithm.lr"]}

    def search(how: Optuna, space_: Any = ways, fixed: str = "dataset.path=a") -> None:
        how.search("train", space_, [fixed], "run", folder)

    search(Optuna(trials=1))
    search(Optuna(trials=2, jobs=2))  # goes on
    assert len(trials(Path(folder))) == 2
    for how, typed, said in (
        (Optuna(), {"fixed": "dataset.path=b"}, "words"),
        (Optuna(minimize=True), {}, "minimize"),
        (Optuna(metric="evaluate/loss"), {}, "metric"),
        (Optuna(), {"space_": other}, "space"),
    ):
        with pytest.raises(InvalidValueError, match=f"holds another search .*{said}.*choose another folder"):
            search(how, **typed)
    with (Path(folder) / LOCK).open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(InvalidValueError, match="another process searches there"):
            search(Optuna(trials=3))


def trials(folder: Path) -> list[tuple[int, str, dict[str, Any], float | None]]:
    backend = optuna.storages.journal.JournalFileBackend(str(folder / JOURNAL))
    study = optuna.load_study(study_name=STUDY, storage=optuna.storages.JournalStorage(backend))
    return [(t.number, t.state.name, t.params, t.value) for t in study.trials]


@pytest.mark.slow
def test_a_search_that_is_killed_ends_with_the_same_trials(tmp_path: Path) -> None:
    aerial_il = [sys.executable, "-m", "aerial_il"]
    collected = [*aerial_il, "collect", "task=reach", "episodes=6", "out=demos", "progress=false"]
    subprocess.run(collected, cwd=tmp_path, check=True, capture_output=True)
    subprocess.run([*aerial_il, *WORDS], cwd=tmp_path, check=True, capture_output=True)
    whole = trials(tmp_path / "search")
    (tmp_path / "search").rename(tmp_path / "whole")
    for patience_s in (8.0, 12.0):
        search = subprocess.Popen([*aerial_il, *WORDS], cwd=tmp_path, stderr=subprocess.DEVNULL)
        time.sleep(patience_s)
        search.kill()
        search.wait()
    done = subprocess.run([*aerial_il, *WORDS], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Best of" in done.stdout
    result = trials(tmp_path / "search")
    assert [params for _, _, params, _ in result] == [params for _, _, params, _ in whole]
    assert len(result) == 6
    both = [(a[3], b[3]) for a, b in zip(result, whole, strict=True) if a[1] == b[1] == "COMPLETE"]
    assert both
    assert all(a == b for a, b in both)
