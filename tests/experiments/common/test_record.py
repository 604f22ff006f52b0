"""A record keeps results by all that decides them: nothing is taken for what it is not."""

from __future__ import annotations

import itertools
import logging
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from aerial_il.benchmarks.parts.records import fingerprint

from experiments.common.record import Record, digest

CODE = '"""Words."""\n\ndef f(x):\n    """More words."""\n    return x + 1  # why\n'


def test_equal_things_lie_in_one_place_and_others_elsewhere_with_the_reason(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    record = Record(tmp_path)
    place = record.place("training", "mlp/reach", {"steps": 10, "policy": {"chunk": 10}})
    assert record.place("training", "mlp/reach", {"policy": {"chunk": 10}, "steps": 10}) == place
    with caplog.at_level(logging.INFO):
        assert record.place("training", "mlp/reach", {"steps": 10, "policy": {"chunk": 20}}) != place
    assert "other policy.chunk" in caplog.text
    assert digest({"a": 1}) != digest({"a": 2})


def test_words_about_code_do_not_count_and_what_it_does_counts(tmp_path: Path) -> None:
    file = tmp_path / "code.py"

    def coded(text: str) -> str:
        file.write_text(text)
        return fingerprint.code_digest([file])

    before = coded(CODE)
    assert coded("def f(x):\n    return x+1\n") == before
    assert coded(CODE.replace("+ 1", "+ 2")) != before
    assert coded('def f(x):\n    """Only words."""\n') != coded("def f(x):\n    return None\n")


HOOKED = """
from aerial_il.core import x
{imported}

def f(y):
    {hook}
    return x
"""


def test_what_is_set_apart_counts_for_none_but_those_that_use_it(tmp_path: Path) -> None:
    """Neither does what brings it in, an import and a branch; a branch on anything else does."""
    file, apart = tmp_path / "code.py", ("policies.parts.residual",)

    def coded(imported: str, hook: str, apart: tuple[str, ...] = apart) -> str:
        file.write_text(HOOKED.format(imported=imported, hook=hook))
        return fingerprint.code_digest([file], apart)

    plain, brought = coded("", ""), "from aerial_il.policies.parts.residual import KEY"
    assert coded(brought, "if KEY in y:\n        return 2") == plain
    assert coded(brought, "if KEY in y:\n        return 2", ()) != plain
    assert coded("", "if y:\n        return 2") != plain
    assert coded("from aerial_il.policies.parts.gated import KEY", "if KEY in y:\n        return 2") != plain


@pytest.mark.parametrize(
    ("room", "file", "decided"),
    [("policies", "residual.py", {"bc_ppo", "residual"}), ("interactive", "rounds.py", {"expert_iteration", "dagger"})],
)
def test_code_that_is_set_apart_is_there_and_decides_those_that_import_it(
    room: str, file: str, decided: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in itertools.chain(*fingerprint.SET_APART):
        path = fingerprint.PACKAGE.joinpath(*module.split("."))
        assert path.is_dir() or path.with_suffix(".py").is_file()
    sources = fingerprint._sources

    def told() -> dict[str, str]:
        """Return the digest of each algorithm's code."""
        fingerprint.learning_code.cache_clear()
        names = ("bc", "sac", "bc_ppo", "residual", "expert_iteration", "dagger")
        return {name: fingerprint.learning_code(name)["code"] for name in names}

    before = told()
    monkeypatch.setattr(fingerprint, "_sources", lambda p: [f for f in sources(p) if (p.name, f.name) != (room, file)])
    now = told()
    fingerprint.learning_code.cache_clear()
    assert {name for name in now if now[name] != before[name]} == decided


class Flown:
    """Two worlds whose episodes end after some steps; the observation, reward and success can be altered a little."""

    def __init__(self, **altered: float) -> None:
        self.num_envs, self.spec, self.ends_at_success = 2, SimpleNamespace(max_steps=5), True
        self.altered, self.step_count = altered, 0
        self.values = np.random.default_rng(0).normal(size=(2, 2000))

    def reset(self, seeds: np.ndarray) -> dict[str, np.ndarray]:
        return {"x": np.zeros((2, 1))}

    def step(self, actions: np.ndarray, mask: np.ndarray) -> Any:
        self.step_count += 1
        obs = {"x": self.step_count * self.values + self.altered.get("obs", 0.0)}
        reward = np.full(2, self.step_count + self.altered.get("reward", 0.0))
        success, none = np.full(2, self.step_count >= 4 + self.altered.get("success", 0.0)), np.zeros(2, bool)
        return SimpleNamespace(obs=obs, reward=reward, info={"success": success}, terminated=none, truncated=none)


def flown(**altered: float) -> str:
    env: Any = Flown(**altered)
    expert: Any = SimpleNamespace(act=lambda obs: obs["x"], reset=lambda: None, attach=lambda env: None)
    return fingerprint._flown(env, expert)


@pytest.mark.parametrize("altered", [{"obs": 1e-6}, {"obs": -1e-3}, {"reward": 1e-4}, {"success": 1.0}])
def test_the_fingerprint_changes_with_any_observation_reward_or_success(altered: dict[str, float]) -> None:
    assert flown(**altered) != flown()


@pytest.mark.parametrize("altered", [{}, {"obs": 1e-12}, {"obs": -1e-12}, {"reward": -1e-9}])
def test_the_fingerprint_is_the_same_where_only_rounding_differs(altered: dict[str, float]) -> None:
    assert flown(**altered) == flown()


@pytest.mark.slow
def test_a_processor_without_fused_multiply_add_gives_the_same_fingerprint() -> None:
    """Records that were made on another machine count: results take hours, and need not be made on each anew."""
    program = (
        "from aerial_il.benchmarks.parts.records.fingerprint import flight_fingerprint as told\n"
        "print(told('fa_hexa_arm4', 'insert_peg', 'gusts'))"
    )
    without = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-FMA4"}
    found = [
        subprocess.run([sys.executable, "-c", program], env={**os.environ, **env}, capture_output=True, check=True)
        for env in ({}, without)
    ]
    assert found[0].stdout == found[1].stdout


def test_each_tier_has_a_fingerprint_of_its_own() -> None:
    reach = fingerprint.flight_fingerprint("fa_hexa_arm4", "reach", "calm")
    assert fingerprint.flight_fingerprint.__wrapped__("fa_hexa_arm4", "reach", "calm") == reach
    assert fingerprint.flight_fingerprint("fa_hexa_arm4", "reach", "gusts") != reach
