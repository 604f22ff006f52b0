"""A search: its space as Hydra writes it, trials that are stopped early, and the same trials after a kill."""

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
from aerial_il.cli.sweepers.optuna import JOURNAL, STUDY, distribution  # noqa: E402

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
    with pytest.raises(InvalidValueError, match="interval"):
        distribution("seed", swept("seed=glob(*)")[0]["seed"])
    with pytest.raises(InvalidValueError, match="nothing to search"):
        swept("seed=3")


def test_a_search_needs_a_sweep(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "run=x", "sweeper=optuna"]) == 2
    assert "add -m" in capsys.readouterr().err


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
