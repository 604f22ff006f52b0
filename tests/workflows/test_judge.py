"""``aerial-il judge`` scores demonstrations by their influence on the flights of the policy that learned from them."""

from pathlib import Path

import pytest

from aerial_il.cli.main import main
from aerial_il.data.dataset import open_dataset
from aerial_il.data.table import read_columns

QUIET = "progress=false"
FLOWN = ["env=gymnasium:Pendulum-v1", "success=return:-40", "max_steps=10", "threads=1", QUIET]
CLONE = [
    "policy.hidden=[8]",
    "policy.chunk=1",
    "policy.ensemble=null",
    "algorithm.steps=2",
    "algorithm.validate_every=0",
]


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with demonstrations, their clone, and flights: the clone's own, and those of chance."""
    home = tmp_path_factory.mktemp("pendulums")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(home)
        assert main(["collect", *FLOWN, "policy=random", "episodes=40", "out=demos"]) == 0
        assert main(["train", "dataset=demos", "run=run", "algorithm.selection.failures=1", *CLONE, QUIET]) == 0
        assert main(["collect", *FLOWN, "policy=run", "episodes=24", "seed=500", "out=flown"]) == 0
    return home


@pytest.fixture(autouse=True)
def inside(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(home)


def test_filter_knows_the_influence_of_every_demonstration(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["judge", "demos", "policy=run", "flown=flown", QUIET]) == 0
    assert 'where="influence > 0" out=demos-helpful' in capsys.readouterr().out
    scores = read_columns(Path("demos"))["influence"]
    assert scores.keys() == {*open_dataset("demos", failures=True).uids}
    assert main(["filter", "demos", "where=influence > 0", "out=helpful", QUIET]) == 0
    assert {*open_dataset("helpful", failures=True).uids} == {uid for uid, score in scores.items() if score > 0.0}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["policy=run"], "influence takes a run, and recordings of its own flights"),
        (["policy=run", "flown=demos"], "demos was flown by random, not by run"),
        (["policy=run", "flown=flown", "output=loss"], "square"),
        (["policy=nowhere", "flown=flown"], "nowhere is not a training run"),
    ],
)
def test_what_says_nothing_of_its_demonstrations_is_refused(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["judge", "demos", *words, QUIET]) == 2
    assert said in capsys.readouterr().err


def test_a_dataset_that_it_did_not_learn_from_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["judge", "flown", "policy=run", "flown=flown", QUIET]) == 2
    assert "flown is not, or no longer, the dataset that the run was trained on" in capsys.readouterr().err
