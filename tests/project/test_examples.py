"""The examples of the pages on adding something are whole: put where they belong, they are found, and they run."""

import importlib
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import aerial_il
from aerial_il import policies, robots
from aerial_il.algorithms.bc import BC
from aerial_il.core import registry
from aerial_il.suite import tasks
from aerial_il.suite.tasks import CellError
from aerial_il.teleop import devices
from tests.algorithms import drift
from tests.contract import placed, test_algorithms, test_success
from tests.contract.test_feasibility import solved

ROOT = Path(__file__).parents[2]
PAGES = ("docs/adding.md", "docs/writing_a_task.md")
FILE = re.compile(r"^`((?:aerial_il|conf|experiments)/[\w/]+\.\w+)`\n\n```\w+\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def files() -> dict[str, str]:
    """Return the files that the pages show: path -> content."""
    return {path: text for page in PAGES for path, text in FILE.findall((ROOT / page).read_text(encoding="utf-8"))}


def registries() -> tuple[object, ...]:
    return (robots.get, tasks.get, tasks.cells)


@contextmanager
def found_beside_ours(top: Path) -> Iterator[None]:
    """Have the registries find the files below ``top`` as they would in a checkout, for a while."""
    with pytest.MonkeyPatch.context() as patch:
        folders = {file.parent for file in top.rglob("*.py") if file.name != "study.py"}
        for folder in folders | {top / "experiments"}:
            package = importlib.import_module(".".join(folder.relative_to(top).parts))
            patch.setattr(package, "__path__", [*package.__path__, str(folder)])
        known = set(sys.modules)
        _forget()
        yield
        for name in set(sys.modules) - known:
            if str(top) in str(getattr(sys.modules[name], "__file__", "")):
                del sys.modules[name]
    _forget()


@pytest.fixture
def added(tmp_path: Path) -> Iterator[None]:
    """All examples, in the folders of their kinds, for one test."""
    for path, text in files().items():
        file = tmp_path / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    with found_beside_ours(tmp_path):
        yield


def _forget() -> None:
    importlib.invalidate_caches()
    for each in registries():
        each.cache_clear()  # type: ignore[attr-defined]


def test_the_robot_flies_and_declines(added: None) -> None:
    assert solved("two_joint_hexa", "reach") == 4
    with pytest.raises(CellError, match="its two joints cannot hold a probe still"):
        aerial_il.load("two_joint_hexa", "inspect_contact")


def test_the_policy_learns(added: None, tmp_path: Path) -> None:
    policy = policies.get("linear")(chunk=1, ensemble=None, anchor=None)
    settings = BC(steps=300, batch_size=64, lr=3e-3, warmup_steps=10, ema=0.9, validation=0.0)
    started, learned = (
        BC.train(each, drift.demonstrations(20), policy, run=tmp_path / name, progress=False)
        for name, each in (("begun", BC(steps=1, validation=0.0)), ("learned", settings))
    )
    assert drift.mean_reward(learned) > drift.mean_reward(started) + 0.05


def test_the_algorithm_fulfils_its_contract(added: None, tmp_path: Path) -> None:
    test_algorithms.test_it_fulfils_the_contract("sac_prior")
    test_algorithms.test_it_learns_more_than_its_start(tmp_path / "learns", "sac_prior")
    test_algorithms.test_killed_in_the_middle_it_ends_with_the_same_bytes(tmp_path / "resumes", "sac_prior")
    test_algorithms.test_impossible_settings_are_refused("sac_prior")


def test_the_device_is_bound(added: None) -> None:
    mapping = yaml.safe_load(files()["conf/device/clicker.yaml"])
    bindings = devices.bindings_of({"clicker": mapping})
    assert bindings.keys_of("record") == ("PageDown",)
    assert set(bindings.controls) == set(devices.controls_of("clicker"))


def test_the_study_answers_its_question(added: None, tmp_path: Path) -> None:
    hovering: Any = registry.get("study", "hovering")
    report = hovering(episodes=2).run(tmp_path, progress=False)
    assert report.verdict == "1 of 1 targets met"


@pytest.mark.slow
def test_the_task_is_solved_by_its_expert_and_judged_alike(added: None, monkeypatch: pytest.MonkeyPatch) -> None:
    assert solved("fa_hexa_arm4", "touch_point") == 4
    text = (ROOT / "docs/writing_a_task.md").read_text(encoding="utf-8")
    rule = re.search(r"^## The second definition of success.*?```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    assert rule
    result = {**vars(placed), **vars(test_success)}
    exec(rule[1], result)
    monkeypatch.setitem(test_success.RULES, "touch_point", test_success.Rule(result["tips_at_point"], result["TOUCH"]))
    test_success.check("touch_point", test_success.judged)
    with pytest.raises(AssertionError, match="the task says True, the instruction False"):
        test_success.check("touch_point", lambda env: np.ones(env.num_envs, bool))
