"""Provenance is complete, plain."""

from __future__ import annotations

import json

from aerial_il.core.provenance import git_state, package_versions, provenance


def test_provenance_is_json_and_names_the_engine() -> None:
    facts = json.loads(json.dumps(provenance(), allow_nan=False))
    assert facts["packages"]["mujoco"].startswith("3.")
    assert set(facts) == {"packages", "git", "python", "platform", "cpu_count"}


def test_git_state_is_a_full_sha_or_nothing() -> None:
    state = git_state()
    assert state is None or (len(state["sha"]) == 40 and isinstance(state["dirty"], bool))


def test_versions_leave_out_what_is_not_installed() -> None:
    assert all(version for version in package_versions().values())
