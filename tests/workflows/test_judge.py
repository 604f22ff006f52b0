"""``aerial-il judge`` scores demonstrations by their influence on the flights of the policy that learned from them."""

from pathlib import Path

import pytest

from aerial_il.cli.main import main
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.table import read_columns
from aerial_il.evaluation.rollouts import known_by
from aerial_il.evaluation.training_run import read_run
from aerial_il.policies import load_policy
from aerial_il.workflows.judge import Judge, require_own
from aerial_il.workflows.parts.learned_from import learned_from
from aerial_il.workflows.parts.run_results import flown_by_others

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


def test_a_dataset_is_known_however_it_is_spelled(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    few = ["train", "dataset=demos", "run=few", "dataset.episodes=8", *CLONE, QUIET]
    assert main([*few, "algorithm.selection.failures=0"]) == 0
    for spelled in ("demos", "demos/", str(home / "demos")):
        assert learned_from(read_run("few"), spelled).kept
    with pytest.raises(InvalidValueError, match="is not, or no longer, the dataset"):
        learned_from(read_run("few"), "flown")


def test_flights_of_other_weights_say_nothing_of_these(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "dataset=demos", "run=anew", "algorithm.selection.failures=1", *CLONE, QUIET]) == 0
    known = known_by(load_policy("anew"))
    asked = Judge(dataset="demos", policy="anew", flown="flown")
    for pilot, settings in (("anew", known), ("elsewhere", known), ("anew", {})):
        require_own({"policy": pilot, "settings": settings}, asked, known)
    for pilot, settings, said in (
        ("anew", {"policy_sha256": "0" * 12}, "by anew with other weights than it has now"),
        ("other", {"policy_sha256": "0" * 12}, "by other, not by anew"),
        ("other", {}, "by other, not by anew"),
    ):
        with pytest.raises(InvalidValueError, match=said):
            require_own({"policy": pilot, "settings": settings}, asked, known)


def test_an_evaluation_by_the_weights_of_before_is_known() -> None:
    train = ["train", "dataset=demos", "run=again", "algorithm.selection.failures=1", *CLONE, QUIET]
    assert main(train) == 0
    judged = ["episodes=2", "videos=0", "success=return:-40", "max_steps=10", "threads=1", QUIET]
    assert main(["evaluate", "policy=again", "out=again/evaluation", *judged]) == 0
    assert flown_by_others(read_run("again")) == set()
    assert main([*train, "seed=1", "resume=false"]) == 0
    assert flown_by_others(read_run("again")) == {"evaluation"}
