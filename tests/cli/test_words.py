"""What is typed is checked against what there is, and composed."""

import pytest

from aerial_il.cli import commands
from aerial_il.cli import words as typed
from aerial_il.cli.commands import Command
from aerial_il.cli.compose import compose, points, settings_of
from aerial_il.cli.known import known
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.policies.mlp import MLP

TRAIN, EVALUATE = commands.find("train"), commands.find("evaluate")


def prepare(command: Command, words: list[str]) -> list[str]:
    return list(typed.read(command, words).overrides)


@pytest.mark.parametrize(
    ("word", "right"),
    [
        ("polcy=mlp", "policy"),
        ("sed=1", "seed"),
        ("policy=mpl", "mlp"),
        ("policy.hiden=[64]", "policy.hidden"),
        ("algorithm.batch=64", "algorithm.batch_size"),
        ("dataset.episode=3", "dataset.episodes"),
        ("--multrun", "--multirun"),
        ("robot=qad", "quad"),
    ],
)
def test_a_wrong_name_is_answered_with_the_nearest(word: str, right: str) -> None:
    with pytest.raises(UnknownNameError, match=f"Did you mean '{right}'"):
        compose(TRAIN, ["run=x", word])


def test_a_wrong_name_of_a_sweep_is_answered_before_it_begins() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'mlp'"):
        prepare(TRAIN, ["-m", "policy=mlp,mpl"])


def test_a_wrong_key_of_a_group_lists_that_group_only() -> None:
    with pytest.raises(UnknownNameError) as caught:
        prepare(TRAIN, ["policy.nonsense=1"])
    assert caught.value.choices
    assert all(choice.startswith("policy.") for choice in caught.value.choices)


@pytest.mark.parametrize("sign", ["", "+", "++"])
def test_a_sign_before_a_key_adds_nothing(sign: str) -> None:
    assert prepare(TRAIN, [f"{sign}algorithm.steps=5"]) == ["algorithm.steps=5"]
    with pytest.raises(UnknownNameError, match="Did you mean 'algorithm'"):
        prepare(TRAIN, [f"{sign}algoritm=bc"])


@pytest.mark.parametrize(
    ("word", "new"),
    [
        ("algorithm.utd_ratio=2", "algorithm.replay.updates_per_step"),
        ("policy.blind_to=[gripper]", "policy.masked_fields"),
        ("algorithm.prior.path=x", None),
        ("policy.utd_ratio=2", None),
    ],
)
def test_an_old_key_is_answered_with_its_new_name(word: str, new: str | None) -> None:
    words = ["algorithm=rlpd", word]
    if new is None:
        with pytest.raises(UnknownNameError, match="Unknown key"):
            prepare(TRAIN, words)
    else:
        with pytest.raises(InvalidValueError, match=f"is called {new} now"):
            prepare(TRAIN, words)


@pytest.mark.parametrize("word", ["train", "--json", "runs/x"])
def test_a_word_that_is_no_override_is_refused(word: str) -> None:
    with pytest.raises((InvalidValueError, UnknownNameError), match="aerial-il train --help"):
        prepare(TRAIN, [word])


@pytest.mark.parametrize(
    ("given", "prepared"),
    [
        ("dataset=datasets/x", "dataset.path=datasets/x"),
        ("dataset=few", "dataset.name=few"),
        ("dataset.path=few", "dataset.path=few"),
        ("policy.hidden=[64,64]", "policy.hidden=[64,64]"),
        ("policy=act", "policy.name=act"),
        ("policy={name:act,chunk:3}", "policy={name:act,chunk:3}"),
        ("policy.loss=l2", "policy.loss=l2"),
        ("tracker=wandb", "tracker=[wandb]"),
        ("expert=null", "expert=null"),
        ("tier=hard-payload", "tier=hard-payload"),
    ],
)
def test_a_path_goes_where_it_belongs(given: str, prepared: str) -> None:
    assert prepare(TRAIN, [given]) == [prepared]


@pytest.mark.parametrize(("words", "name"), [([], None), (["tier=gusts"], "gusts"), (["tier=calm+wind"], "calm+wind")])
def test_a_tier_may_be_left_out_where_a_dataset_may_say_it(words: list[str], name: str | None) -> None:
    assert compose(TRAIN, ["run=x", *words]).tier == name
    with pytest.raises(UnknownNameError, match="Did you mean 'gusts'"):
        compose(TRAIN, ["run=x", "tier=gust"])


def test_an_evaluated_policy_is_always_a_path() -> None:
    assert prepare(EVALUATE, ["policy=mlp"]) == ["policy=mlp"]


def test_bare_words_fill_keys_and_json_is_a_flag() -> None:
    assert prepare(commands.find("compare"), ["x", "y", "--json"]) == ["json=true", "result=[x,y]"]
    with pytest.raises(InvalidValueError, match="is not KEY=VALUE"):
        prepare(commands.find("replay"), ["x", "y", "z"])


def test_a_sweep_gives_each_job_a_folder_of_its_own() -> None:
    words = ["-m", "seed=0,1", "policy=mlp,act", "dataset=few,all", "policy.hidden=[8,8]", "run=top"]
    result = points(TRAIN, prepare(TRAIN, words))
    assert [folder for _, folder in result][:2] == [
        "top/seed=0,policy=mlp,dataset=few",
        "top/seed=0,policy=mlp,dataset=all",
    ]
    assert len(result) == 8
    settings = settings_of(TRAIN, [*result[0][0], "seed=3"])
    assert (settings.run, settings.seed, settings.dataset.episodes) == ("top/seed=0,policy=mlp,dataset=few", 3, 25)
    with pytest.raises(InvalidValueError, match="run cannot be swept"):
        points(TRAIN, prepare(TRAIN, ["-m", "run=a,b"]))
    with pytest.raises(InvalidValueError, match="a sweep takes A,B"):
        points(TRAIN, prepare(TRAIN, ["-m", "run=a", "algorithm.lr=interval(0,1)"]))


def test_a_sweep_chooses_by_a_pattern() -> None:
    assert "policy.name=gmm,gmm_robomimic" in prepare(TRAIN, ["-m", "policy=glob(gmm*)", "run=x"])
    assert "policy.name=choice(mlp,act)" in prepare(TRAIN, ["-m", "policy=choice(mlp,act)", "run=x"])


def test_known_keys_follow_what_is_chosen() -> None:
    assert "policy.hidden" in known(TRAIN.settings, {"policy": ["mlp"]})
    assert "policy.hidden" not in known(TRAIN.settings, {"policy": ["act"]})
    assert "algorithm.gate.least" in known(TRAIN.settings, {"algorithm": ["thrifty_dagger"]})
    assert "algorithm.gate.least" not in known(TRAIN.settings, {"algorithm": ["dagger"]})


def test_composition_gives_typed_settings() -> None:
    settings = compose(TRAIN, ["dataset=datasets/x", "run=runs/y", "seed=3", "policy.chunk=7"])
    assert isinstance(settings, TRAIN.settings)
    assert (settings.dataset.path, settings.run, settings.seed) == ("datasets/x", "runs/y", 3)
    assert settings.policy == MLP(chunk=7)


def test_a_value_may_refer_to_another_key() -> None:
    assert compose(TRAIN, ["run=x", "seed=7", "algorithm.steps=${seed}"]).algorithm.steps == 7


def test_what_the_user_must_say_is_asked_for() -> None:
    with pytest.raises(InvalidValueError, match=r"evaluate needs out=\.\.\."):
        compose(EVALUATE, [])


def test_values_outside_their_limits_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="episodes=0 is too small: the minimum is 1"):
        compose(EVALUATE, ["policy=x", "out=y", "episodes=0"])
