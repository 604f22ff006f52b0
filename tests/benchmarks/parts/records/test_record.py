"""A record keeps results by all that decides them: nothing is taken for what it is not."""

from __future__ import annotations

import logging
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from aerial_il.benchmarks.parts.records import fingerprint
from aerial_il.benchmarks.parts.records.record import Record, digest

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


class Flown:
    """Two worlds whose episodes end after some steps; the observation, reward and success can be altered a little."""

    def __init__(self, **altered: float) -> None:
        self.num_envs, self.spec, self.ends_at_success = 2, SimpleNamespace(max_steps=5), True
        self.altered, self.step_count = altered, 0

    def reset(self, seeds: np.ndarray) -> dict[str, np.ndarray]:
        return {"x": np.zeros((2, 1))}

    def step(self, actions: np.ndarray, mask: np.ndarray) -> Any:
        self.step_count += 1
        values = {name: np.full(2, self.step_count + self.altered.get(name, 0.0)) for name in ("obs", "reward")}
        success = np.full(2, self.step_count >= 4 + self.altered.get("success", 0.0))
        none, obs = np.zeros(2, bool), {"x": values["obs"][:, None]}
        return SimpleNamespace(
            obs=obs, reward=values["reward"], info={"success": success}, terminated=none, truncated=none
        )


@pytest.mark.parametrize("altered", [{"obs": 1e-12}, {"reward": 1e-12}, {"success": 1.0}])
def test_the_fingerprint_changes_with_any_observation_reward_or_success(altered: dict[str, float]) -> None:
    expert = SimpleNamespace(act=lambda obs: obs["x"], reset=lambda: None, attach=lambda env: None)
    assert fingerprint._flown(Flown(), expert) == fingerprint._flown(Flown(), expert)
    assert fingerprint._flown(Flown(**altered), expert) != fingerprint._flown(Flown(), expert)


def test_each_tier_has_a_fingerprint_of_its_own() -> None:
    reach = fingerprint.flight_fingerprint("fa_hexa_arm4", "reach", "calm")
    assert fingerprint.flight_fingerprint.__wrapped__("fa_hexa_arm4", "reach", "calm") == reach
    assert fingerprint.flight_fingerprint("fa_hexa_arm4", "reach", "gusts") != reach
