"""Demonstrators for environments from outside, read from files that others published; nothing in them is unpickled."""

import os

from aerial_il.core.errors import UnknownNameError
from aerial_il.experts.outside.dapg import DapgExpert

DAPG_TASKS = {  # key of an environment -> name in the file
    "gymnasium:AdroitHandDoor-v1": "door",
    "gymnasium:AdroitHandRelocate-v1": "relocate",
}


def load_expert(path: str | os.PathLike[str], env: str, *, noise: float = 1.0) -> DapgExpert:
    """Return the expert of an environment.

    Args:
        path: ``dapg_policies.npz``. env: key of the environment. noise: see :class:`DapgExpert`.

    Raises:
        UnknownNameError: there is none for ``env``. InvalidValueError: the file lacks it or cannot be read.
    """
    if env not in DAPG_TASKS:
        raise UnknownNameError("environment with an expert in a file", env, DAPG_TASKS)
    return DapgExpert.load(path, DAPG_TASKS[env], noise=noise)
