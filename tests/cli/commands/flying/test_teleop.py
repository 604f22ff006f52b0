"""What ``aerial-il teleop`` does before its page is there."""

from __future__ import annotations

import subprocess
import sys

import pytest

import aerial_il
from aerial_il.core.errors import InvalidValueError
from aerial_il.workflows.teleop import ROBOT, TASK, _flown_once

# In a process of its own: what compiles, how often, and on which thread.
COMPILES = """
import threading
import numpy as np
import aerial_il
from aerial_il.workflows.teleop import _flown_once
from aerial_il.suite.episode import simulation

compiled = []
plain = simulation.entry_of

def counted(function, *arguments):
    compiled.append((function.__name__, threading.current_thread() is threading.main_thread()))
    return plain(function, *arguments)

simulation.entry_of = counted
env = _flown_once(aerial_il.load_batch(ROBOT, TASK, num_envs=1, num_threads=1))
before = list(compiled)
assert ("fly", True) in before, before
for seed in range(2):
    env.reset(seed)
    env.step(np.zeros((1, env.spec.action.size)))
assert compiled == before, compiled
"""


def test_what_flies_is_compiled_before_anybody_flies() -> None:
    """On the thread that flies, half a minute of compiling would keep Ctrl-C waiting and the page still."""
    code = COMPILES.replace("ROBOT", repr(ROBOT)).replace("TASK", repr(TASK))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_what_nobody_flies_by_hand_is_refused_before_it_is_flown() -> None:
    env = aerial_il.load_batch(ROBOT, TASK, num_envs=2, num_threads=1)
    try:
        with pytest.raises(InvalidValueError, match="a person flies one world"):
            _flown_once(env)
    finally:
        env.close()
