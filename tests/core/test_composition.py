"""Settings are composed of plain values; one of another type than its setting declares is answered by name."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import pytest

from aerial_il.cli.main import main
from aerial_il.core import presets
from aerial_il.core.composition import build, fits, plain
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.schema import Choice, Name, keys, meanings
from aerial_il.policies.act import ACT
from aerial_il.policies.mlp import MLP


@dataclass(frozen=True, kw_only=True)
class Place:
    """A place.

    Attributes:
        path: where.
        count: how many, over
            two lines.
    """

    path: str | None = None
    count: int = 1


@dataclass(frozen=True, kw_only=True)
class Job:
    """A job.

    Attributes:
        seed, steps: numbers.
        place: whence.
    """

    PRESETS: ClassVar[dict[str, str]] = {"experiment": "a set of values"}

    out: str
    seed: int = 0
    steps: float = 1.0
    kind: Literal["short", "long"] = "short"
    sizes: tuple[int, ...] = (3,)
    pair: tuple[int, int] = (1, 2)
    place: Place = Place()
    prior: Place | None = None
    robot: Annotated[str | None, Name("robot")] = None
    policy: Annotated[Any, Choice("policy")] = "mlp"
    clones: Mapping[str, MLP] = field(default_factory=lambda: {"a": MLP(), "b": MLP(chunk=2)})


@pytest.mark.parametrize(
    ("given", "name", "value"),
    [
        ({"seed": 3}, "seed", 3),
        ({"steps": 2}, "steps", 2),
        ({"sizes": [1, 2]}, "sizes", (1, 2)),
        ({"sizes": 7}, "sizes", (7,)),
        ({"place": {"count": 2}}, "place", Place(count=2)),
        ({"place": "x"}, "place", Place(path="x")),
        ({"place": Path("x")}, "place", Place(path="x")),
        ({"place": Place(count=9)}, "place", Place(count=9)),
        ({"prior": {"path": "p"}}, "prior", Place(path="p")),
        ({"prior": None}, "prior", None),
        ({"robot": "quad"}, "robot", "quad"),
        ({"policy": "act"}, "policy", ACT()),
        ({"policy": {"name": "act", "chunk": 3}}, "policy", ACT(chunk=3)),
        ({"policy": {"chunk": 3}}, "policy", MLP(chunk=3)),
        ({"policy": MLP(chunk=9)}, "policy", MLP(chunk=9)),
        ({"clones": {"b": {"execute": 2}}}, "clones", {"a": MLP(), "b": MLP(chunk=2, execute=2)}),
        ({"clones": {"a": None}}, "clones", {"b": MLP(chunk=2)}),
    ],
)
def test_a_value_becomes_what_its_hint_wants(given: dict[str, Any], name: str, value: object) -> None:
    assert getattr(build(Job, {"out": "o", **given}), name) == value


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"sed": 3}, "Unknown key 'sed'. Did you mean 'seed'"),
        ({"seed": "abc"}, "seed='abc' is not a whole number"),
        ({"seed": True}, "seed=True is not a whole number"),
        ({"kind": "wide"}, "kind='wide' is not one of short, long"),
        ({"pair": [1]}, r"pair=\[1\] is not a list"),
        ({"place": 3}, "place=3: it is a group; set one of its keys, place.path, place.count"),
        ({"place": {"cont": 3}}, "Unknown key 'place.cont'. Did you mean 'place.count'"),
        ({"robot": "qad"}, "Unknown robot 'qad'. Did you mean 'quad'"),
        ({"policy": "atc"}, "Unknown policy 'atc'. Did you mean 'act'"),
        ({"policy": None}, "Unknown policy None"),
        ({"policy": {"name": ["act"]}}, "Unknown policy"),
        ({"policy": {"name": "act", "chnk": 3}}, "Unknown key 'policy.chnk'. Did you mean 'policy.chunk'"),
        ({"policy": {"name": "act", "chunk": "x"}}, "policy.chunk='x' is not a whole number"),
        ({"out": None}, "out=None is not text"),
    ],
)
def test_what_does_not_fit_is_answered(given: dict[str, Any], said: str) -> None:
    with pytest.raises((UnknownNameError, InvalidValueError), match=said):
        build(Job, {"out": "o", **given})


def test_what_is_missing_is_asked_for() -> None:
    with pytest.raises(InvalidValueError, match=r"job needs out=\.\.\."):
        build(Job, {})


def test_a_preset_stands_below_what_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, text in {
        "experiment/quick": "seed: 5\nsteps: 9\npolicy: {hidden: [8]}\n",
        "place/far": "count: 7\n",
        "policy/wide": "name: mlp\nhidden: [64]\n",
        "policy/act": "chunk: 33\n",
    }.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / f"{name}.yaml").write_text(text)
    monkeypatch.setattr(presets, "folder", lambda: tmp_path)
    quick = {"out": "o", "experiment": "quick"}
    result = build(Job, {**quick, "seed": 6, "place": {"name": "far", "path": "p"}})
    assert (result.seed, result.steps, result.policy, result.place) == (
        6,
        9,
        MLP(hidden=(8,)),
        Place(path="p", count=7),
    )
    assert build(Job, {**quick, "policy": "wide"}).policy == MLP(hidden=(8,))
    assert build(Job, {"out": "o", "policy": "act"}).policy == ACT(chunk=33)
    assert build(Job, {"out": "o", "place": Path("far")}).place == Place(path="far")
    with pytest.raises(
        InvalidValueError, match=r"experiment=quick sets policy\.hidden, which policy=act does not have"
    ):
        build(Job, {**quick, "policy": "act"})
    with pytest.raises(UnknownNameError, match="Did you mean 'quick'"):
        build(Job, {"out": "o", "experiment": "quik"})


def test_settings_lead_to_plain_values_and_back() -> None:
    job = build(Job, {"out": "o", "policy": {"name": "act", "chunk": 3}, "prior": "p"})
    assert plain(job)["policy"]["name"] == "act"
    assert build(Job, plain(job)) == job


def test_keys_have_defaults_and_meanings() -> None:
    result = {key.name: key for key in keys(Job)}
    assert meanings(Place)["count"] == "how many, over two lines."
    assert (result["seed"].meaning, result["seed"].default) == ("numbers.", "0")
    assert (result["out"].default, result["prior"].default, result["prior.path"].default) == ("", "null", "null")
    assert {result[name].takes for name in ("place", "prior")} == {"place"}
    assert (result["policy"].takes, result["policy"].kind, result["robot"].kind) == ("choice", "policy", "robot")
    assert (result["sizes"].default, result["kind"].options) == ("[3]", ("short", "long"))


@dataclass
class Inner:
    rate: float = 0.1


@pytest.mark.parametrize(
    ("hint", "good", "bad"),
    [
        (int, [0, -3], [1.5, True, "1", None, [1], {}]),
        (float, [1, 0.5, float("nan")], [True, "x", None, []]),
        (bool, [True], [1, "true", None]),
        (str, ["", "x"], [1, None, []]),
        (int | None, [None, 2], ["x", 0.5]),
        (tuple[int, ...], [[], [1, 2], (3,)], [[1, "x"], 1, "12", None]),
        (tuple[int, int], [[1, 2]], [[1], [1, 2, 3], [[1], 2]]),
        (list[str], [["a"]], [[["a"]], "a", [None]]),
        (Literal["hand", "script"], ["hand"], ["foot", 1, []]),
        (Mapping[str, float], [{}, {"a": 1}], [{"a": "x"}, [], 3]),
        (Inner, [Inner()], [3, "x", [], None]),
        (Any, [3, "x", None, []], []),
    ],
)
def test_values_fit_or_do_not(hint: Any, good: list[Any], bad: list[Any]) -> None:
    assert [value for value in good if not fits(value, hint)] == []
    assert [value for value in bad if fits(value, hint)] == []


def test_on_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", "result=[[1]]"]) == 2
    assert "result=[[1]] is not a list such as [a,b]" in capsys.readouterr().err
    assert main(["train", "dataset=nowhere", "run=x", "algorithm.patience=[2]"]) == 2
    assert "patience=[2] is not a whole number" in capsys.readouterr().err
