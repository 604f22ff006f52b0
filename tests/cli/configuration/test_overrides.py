"""What is typed is checked against what there is, before Hydra sees it."""

from __future__ import annotations

import pytest

from aerial_il.cli import commands
from aerial_il.cli.configuration.compose import compose
from aerial_il.cli.configuration.overrides import known_keys, prepare
from aerial_il.core.errors import InvalidValueError, UnknownNameError

TRAIN, EVALUATE, BENCH = (commands.find(name) for name in ("train", "evaluate", "bench"))


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
        ("policy=mlp,mpl", "mlp"),
    ],
)
def test_a_wrong_name_is_answered_with_the_nearest_valid_one(word: str, right: str) -> None:
    with pytest.raises(UnknownNameError, match=f"Did you mean '{right}'"):
        prepare(TRAIN, [word])


def test_a_wrong_key_inside_a_group_lists_the_keys_of_that_group_only() -> None:
    with pytest.raises(UnknownNameError) as caught:
        prepare(TRAIN, ["policy.nonsense=1"])
    assert caught.value.choices
    assert all(choice.startswith("policy.") for choice in caught.value.choices)


@pytest.mark.parametrize("word", ["+algoritm.steps=5", "+algoritm=bc"])
def test_a_key_that_is_added_must_belong_to_one_of_the_command(word: str) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'algorithm'"):
        prepare(TRAIN, [word])


def test_a_launcher_is_chosen_as_a_group_or_not_at_all() -> None:
    with pytest.raises(InvalidValueError, match="hydra/launcher=joblib"):
        prepare(TRAIN, ["-m", "seed=0,1", "hydra.launcher=joblib"])
    assert "hydra.launcher.n_jobs=2" in prepare(TRAIN, ["-m", "seed=0,1", "hydra.launcher.n_jobs=2"])


def test_an_old_key_is_answered_with_its_new_name() -> None:
    with pytest.raises(InvalidValueError, match=r"bench\.sac\.tau is called bench\.sac\.critics\.tau now"):
        prepare(BENCH, ["z1_reach", "bench.sac.tau=0.01"])
    with pytest.raises(UnknownNameError):
        prepare(BENCH, ["z1_reach", "bench.policy.tau=0.01"])


def test_the_folder_of_a_job_of_a_sweep_can_be_evaluated() -> None:
    config = compose(EVALUATE, ["policy=runs/x/seed=0", "out=runs/x/seed=0/evaluation"])
    assert (config.policy.path, config.out) == ("runs/x/seed=0", "runs/x/seed=0/evaluation")


@pytest.mark.parametrize("word", ["train", "--json", "runs/x"])
def test_a_word_that_is_no_override_is_refused(word: str) -> None:
    with pytest.raises((InvalidValueError, UnknownNameError), match="aerial-il train --help"):
        prepare(TRAIN, [word])


@pytest.mark.parametrize(
    ("given", "prepared"),
    [
        ("dataset=datasets/x", "dataset.path=datasets/x"),
        ("dataset=few", "dataset=few"),
        ("dataset.path=few", "dataset.path=few"),
        ("policy.hidden=[64,64]", "policy.hidden=[64,64]"),
        ("hydra.verbose=true", "hydra.verbose=true"),
        ("+policy.new=1", "+policy.new=1"),
    ],
)
def test_a_path_goes_where_it_belongs_and_a_choice_stays_a_choice(given: str, prepared: str) -> None:
    assert prepare(TRAIN, [given]) == [prepared]


@pytest.mark.parametrize(
    ("given", "prepared"),
    [
        ("tier=gusts", "tier=gusts"),
        ("tier=calm,hard", "tier=calm,hard"),
        ("tier=hard-payload", "tier.name=hard-payload"),
        ("tier=calm+latency+wind", "tier.name=calm+latency+wind"),
        ("tier=gusts,calm+wind", "tier.name=gusts,calm+wind"),
    ],
)
def test_a_tier_may_be_put_together(given: str, prepared: str) -> None:
    assert prepare(EVALUATE, [given]) == [prepared]


@pytest.mark.parametrize(
    ("word", "says"),
    [
        ("tier=gust", "Unknown tier 'gust'. Did you mean 'gusts'"),
        ("tier=gust+wind", "Unknown tier 'gust'. Did you mean 'gusts'"),
        ("tier=calm+latncy", "Unknown tier component 'latncy'. Did you mean 'latency'"),
        ("tier=calm-wind", "Tier 'calm' has no wind anyway"),
    ],
)
def test_a_wrong_tier_is_refused_before_anything_flies(word: str, says: str) -> None:
    with pytest.raises((UnknownNameError, InvalidValueError)) as caught:
        compose(EVALUATE, ["policy=x", "out=x", word])
    assert says in str(caught.value)


def test_a_tier_put_together_reaches_the_command() -> None:
    chosen = compose(EVALUATE, ["policy=x", "out=x", "tier=calm+wind+latency"])
    assert chosen.tier.name == "calm+wind+latency"


@pytest.mark.parametrize(("words", "name"), [([], None), (["tier=gusts"], "gusts"), (["tier=calm+wind"], "calm+wind")])
def test_a_tier_may_be_left_out_where_a_dataset_may_say_it(words: list[str], name: str | None) -> None:
    assert compose(TRAIN, ["run=x", *words]).tier.name == name
    with pytest.raises(UnknownNameError, match="Did you mean 'gusts'"):
        compose(TRAIN, ["run=x", "tier=gust"])


def test_an_evaluated_policy_is_always_a_path() -> None:
    assert prepare(EVALUATE, ["policy=mlp"]) == ["policy.path=mlp"]


def test_bare_words_fill_positional_keys_and_json_is_a_flag_where_it_exists() -> None:
    assert prepare(commands.find("compare"), ["x", "y", "--json"]) == ["a=x", "b=y", "json=true"]
    with pytest.raises(InvalidValueError, match="'z' is not KEY=VALUE"):
        prepare(commands.find("compare"), ["x", "y", "z"])


def test_a_sweep_gives_each_job_a_folder_named_after_what_is_swept() -> None:
    assert prepare(TRAIN, ["-m", "seed=0,1", "policy.hidden=[8,8]"])[-1] == "hydra.sweep.subdir='seed=${seed}'"
    with pytest.raises(InvalidValueError, match="run cannot be swept"):
        prepare(TRAIN, ["-m", "run=a,b"])


def test_known_keys_follow_the_chosen_file() -> None:
    with_file = known_keys(TRAIN, {"policy": "mlp"})
    assert "policy.hidden" in with_file
    assert "policy.hidden" not in known_keys(TRAIN, {"policy": None})


def test_composition_gives_a_typed_object() -> None:
    config = compose(TRAIN, ["dataset=datasets/x", "run=runs/y", "seed=3", "policy.chunk=7"])
    assert isinstance(config, TRAIN.config)
    assert (config.dataset.path, config.run, config.seed, config.policy["chunk"]) == ("datasets/x", "runs/y", 3, 7)
    assert config.policy["_target_"].endswith("MLP")


def test_what_the_user_must_say_is_asked_for() -> None:
    with pytest.raises(InvalidValueError, match=r"evaluate needs out=\.\.\. policy=\.\.\."):
        compose(EVALUATE, [])


def test_values_outside_their_limits_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="episodes=0 is too small: the minimum is 1"):
        compose(EVALUATE, ["policy=x", "out=y", "episodes=0"])
