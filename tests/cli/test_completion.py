"""Tab completion offers what can be typed next, in a real shell too."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import aerial_il
from aerial_il.cli import commands, completion
from aerial_il.core import schema


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        (["aerial-il", "trai"], ["train"]),
        (["aerial-il", "train", "policy="], [f"policy={name}" for name in schema.options("policy")]),
        (["aerial-il", "train", "policy.hid"], ["policy.hidden="]),
        (["aerial-il", "evaluate", "robot=ua"], ["robot=ua_quad_arm4"]),
        (["aerial-il", "list", "json="], ["json=true", "json=false"]),
        (["aerial-il", "train", "--mul"], ["--multirun"]),
        (["aerial-il", "nonsense", "a"], []),
    ],
)
def test_candidates(line: list[str], offered: list[str]) -> None:
    assert completion.candidates(line) == offered


def test_commands_are_offered_first_and_keys_once() -> None:
    assert set(commands.names()) <= set(completion.candidates(["aerial-il", "''"]))
    assert "seed=" not in completion.candidates(["aerial-il", "train", "seed=1", "''"])


def test_only_tasks_that_the_robot_can_do_are_offered() -> None:
    offered = completion.candidates(["aerial-il", "collect", "robot=quad", "task="])
    assert offered == [f"task={task}" for robot, task in aerial_il.list_cells() if robot == "quad"]
    offered = completion.candidates(["aerial-il", "teleop", "task=hover", "robot="])
    assert offered == ["robot=quad"]
    every = completion.candidates(["aerial-il", "collect", "robot=nonsense", "task="])
    assert every == [f"task={task}" for task in aerial_il.list_tasks()]


AGAIN = """
import sys
from aerial_il.cli import completion
assert "algorithm.critics.count=" in completion.candidates(["aerial-il", "train", "algorithm=rlpd", "algorithm.cri"])
assert ("torch" in sys.modules) == (sys.argv[1] == "first"), sys.argv
"""


REPAIRED = """
import pathlib
import sys
from aerial_il.cli import completion
file = pathlib.Path(sys.argv[1])
whole = file.read_text()
for spoilt in ('{"state": null}', "[", whole.replace('"state": [', '"state": [1, ')):
    assert spoilt != whole
    file.write_text(spoilt)
    offered = completion.candidates(["aerial-il", "train", "algorithm=rlpd", "algorithm.cri"])
    assert "algorithm.critics.count=" in offered
    assert file.read_text() == whole, "it was not believed"
"""


def test_what_a_choice_has_is_remembered_until_its_file_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for time in ("first", "second"):
        subprocess.run([sys.executable, "-c", AGAIN, time], check=True)
    (file,) = tmp_path.glob("aerial_il/algorithm-rlpd.json")
    subprocess.run([sys.executable, "-c", REPAIRED, file], check=True)


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
@pytest.mark.parametrize(
    ("line", "reply"),
    [("aerial-il eval", "evaluate"), ("aerial-il evaluate tier=c", "calm"), ("aerial-il train pol", "policy=")],
)
def test_in_bash(line: str, reply: str) -> None:
    setup = f'eval "$(aerial-il completion bash)"; COMP_LINE={line!r}; COMP_POINT=${{#COMP_LINE}}; _aerial_il'
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", setup + '; echo "${COMPREPLY[*]}"'],
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == reply
