"""Whatever a shell can give is a path, and what a command prints may be pasted into a shell."""

import shlex
import subprocess
from pathlib import Path
from typing import Any

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from hypothesis import example, given, settings
from hypothesis import strategies as st
from omegaconf import OmegaConf

from aerial_il.cli import commands
from aerial_il.cli.compose import compose, points
from aerial_il.cli.main import main
from aerial_il.cli.words import literals, read
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.workflows import spelling
from aerial_il.workflows.spelling import command_line, literal
from aerial_il.workflows.train import command as command_of

HOSTILE = [
    "/data/数据/ds", "ünï", "a=b", "com,ma", "br[a]", "[a]", "{a:b}", "it's", 'say "hi"', "two words", " ", "$HOME",
    "${seed}",
    "\\${seed}", "back\\slash", "end\\", "end\\'", "a&b;rm", "`id`", "$(id)", "null", "true", "007", "1e3", ".5",
    "#1", "~x",
    "*", "?", "!", "(x)", "choice(a,b)", "range(3)", "glob(*)", "a:b", "a|b", "100%", "few", "-m", "line\nbreak", "\t",
    "'quoted'", "runs/sw2/seed=0", "@x", "a+b", "??", "<a>", "^",
]  # fmt: skip
letters = st.characters(exclude_categories=("Cs",), exclude_characters="\x00")
names = st.one_of(
    st.text("ab=,[]{}'\"\\$ :.;&()*#~/-数ü\n", min_size=1, max_size=12), st.text(letters, min_size=1, max_size=12)
)
TRAIN, EVALUATE, REPORT = map(commands.find, ("train", "evaluate", "report"))


def every_hostile_name(test: Any) -> Any:
    for name in HOSTILE:
        test = example(name)(test)
    return test


def taken(command: commands.Command, words: list[str]) -> dict[str, Any]:
    """Return what Hydra's own parser and OmegaConf take each word for, much faster than a composition does.

    That a composition agrees is tried with every hostile name below.
    """
    found = {}
    for override in OverridesParser.create().parse_overrides(list(read(command, words).overrides)):
        assert not override.is_sweep_override()
        found[override.key_or_group] = OmegaConf.create({"value": override.value()}).value
    return found


@pytest.mark.parametrize(("name", "other"), list(zip(HOSTILE[::2], HOSTILE[1::2], strict=True)))
def test_a_composition_takes_a_path_as_it_stands(name: str, other: str) -> None:
    given_words = [f"policy={name}", f"out={other}"]
    config = compose(EVALUATE, given_words)
    assert (config.policy, config.out) == (name, other)
    assert taken(EVALUATE, given_words) == {"policy": name, "out": other}


@every_hostile_name
@settings(deadline=None, max_examples=150)
@given(names)
def test_a_path_is_taken_as_it_stands(name: str) -> None:
    if name == "???":
        return  # what OmegaConf takes for "not said"
    assert taken(EVALUATE, [f"policy={name}", f"out={name}"]) == {"policy": name, "out": name}


def test_a_composition_takes_each_of_several_paths_as_it_stands() -> None:
    assert list(compose(REPORT, [f"result=[{','.join(map(literal, HOSTILE))}]", "run=x"]).result) == HOSTILE


@every_hostile_name
@settings(deadline=None, max_examples=60)
@given(names)
def test_each_of_several_paths_is_taken_as_it_stands(name: str) -> None:
    bare = [] if name.startswith(("-", "+", "~")) or "=" in name else [name]
    given_words = [*bare, "other"] if bare else [f"result=[{literal(name)}]"]
    run = name if name not in ("null", "???") else "run"
    found = taken(REPORT, [*given_words, f"run={run}"])
    assert (found["result"][0], found["run"]) == (name, run)


@every_hostile_name
@settings(deadline=None, max_examples=60)
@given(names)
def test_what_comes_next_may_be_pasted_into_a_shell(name: str) -> None:
    if name == "???":
        return
    for line, command, key in (
        (command_line(["train", spelling.path("dataset", name), "run=runs/x"]), TRAIN, "dataset.path"),
        (command_line(["evaluate", spelling.path("policy", name), f"out={name}/evaluation"]), EVALUATE, "policy"),
    ):
        program, said, *rest = shlex.split(line)
        assert (program, said) == ("aerial-il", command.name)
        assert Path(taken(command, rest)[key]) == Path(name)


@pytest.mark.parametrize("name", ["it's", "a&b;rm", "$HOME", "${seed}", "数据", "two  words", "`id`", "line\nbreak"])
def test_a_real_shell_reads_the_line_alike(name: str) -> None:
    line = command_line(["train", f"dataset={name}"]).removeprefix("aerial-il")
    done = subprocess.run(["sh", "-c", f"printf '%s\\0' {line}"], capture_output=True, check=True)
    assert done.stdout.decode().split("\0")[:2] == ["train", f"dataset={name}"]


def test_what_training_says_of_itself_leads_back_to_it() -> None:
    typed = [
        "dataset=数据/it's",
        "run=a,b",
        "expert=x y.npz",
        "policy.hidden=[8,8]",
        "policy.loss=l2",
        "evaluate_tier=gusts",
    ]
    settings = compose(TRAIN, typed)
    assert compose(TRAIN, shlex.split(command_of(settings))[2:]) == settings


@pytest.mark.parametrize(
    "typed",
    [
        ["dataset=x"],
        ["dataset=x", "policy.hidden=[64,32]"],
        ["dataset=x", "algorithm.steps=7", "algorithm.minutes=0.5"],
        ["dataset=x", "policy.ensemble=null", "policy.loss=l2"],
        ["policy=act_paper", "policy.loss=l2", "algorithm=sac", "algorithm.prior=a b", "env=gymnasium:Hopper-v5"],
        ["dataset=x", "algorithm=hg_dagger", "algorithm.training.steps=7", "dataset.by_hand=false"],
        ["dataset=x", "algorithm=dagger", "algorithm.gate.hold=3"],
    ],
)
def test_words_and_settings_are_equivalent(typed: list[str]) -> None:
    settings = compose(TRAIN, ["run=y", *typed])
    said = spelling.words_of(settings)
    assert sorted(said) == sorted(["run=y", *typed])
    assert compose(TRAIN, said) == compose(TRAIN, ["run=y", *typed])


@pytest.mark.parametrize(
    ("value", "swept"), [("a,b", "a,b"), ("数,b", "'数',b"), ("'a,b',c", "'a,b',c"), ("a=1,it's", "'a=1','it\\'s'")]
)
def test_a_sweep_parts_values_at_commas_outside_of_quotes(value: str, swept: str) -> None:
    assert literals(value) == swept
    assert read(EVALUATE, ["-m", f"policy={value}", "out=x"]).overrides[0] == f"policy={swept}"


def test_a_sweep_by_a_function_stays_one() -> None:
    assert literals("glob(*)") == "glob(*)"


def test_a_sweep_over_paths_runs_each_of_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["train", "-m", "dataset=数据,b=c,'d,e'", "run=out/数=据"]) == 2  # none of them is there
    said = read(TRAIN, ["-m", "dataset=数据,b=c,'d,e'", "run=out/数=据"]).overrides
    made = [str(Path(folder).relative_to("out/数=据")) for _, folder in points(TRAIN, said)]
    assert made == ["dataset.path=数据", "dataset.path=b=c", "dataset.path=d,e"]


@pytest.mark.parametrize("name", ["a=b", "sweep/seed=0", "ü=x"])
def test_a_bare_path_may_hold_an_equals_sign(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).mkdir(parents=True)
    assert compose(commands.find("info"), [name]).path == name


def test_a_learning_curve_of_hostile_paths() -> None:
    config = compose(REPORT, ["x", "learning_curve={10:数据/a=b,25:'c,d'}"])
    assert dict(config.learning_curve) == {10: "数据/a=b", 25: "c,d"}


def test_a_wrong_key_is_still_told() -> None:
    with pytest.raises(UnknownNameError, match="Unknown key 'ot'"):
        read(EVALUATE, ["ot=x"])
    with pytest.raises(InvalidValueError, match="not KEY=VALUE"):
        read(TRAIN, ["a/b=x"])


NAMES = ("数据", "a=b", "com,ma", "br[a]", "it's", "$HOME ${x}")


@pytest.mark.parametrize("name", [" ".join(NAMES), *(pytest.param(name, marks=pytest.mark.slow) for name in NAMES)])
def test_flights_are_recorded_and_described_under_any_name(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    flown = ["env=gymnasium:CartPole-v1", "policy=random", "success=survived", "max_steps=3", "episodes=2"]
    assert main(["collect", *flown, f"out={name}", "progress=false"]) == 0
    following = capsys.readouterr().out.splitlines()[-1].removeprefix("Next: ")
    assert compose(TRAIN, shlex.split(following)[2:]).dataset.path == name
    assert main(["info", f"path={name}"]) == 0
    assert main(["validate", name if "=" not in name else f"path={name}", "progress=false"]) == 0
    assert len(list((tmp_path / name / "demos").glob("*.mcap"))) == 2
