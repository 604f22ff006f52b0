"""Code of the user's own, named on the command line as ``module:factory``: only what is typed may name code."""

import hashlib
import importlib
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from aerial_il.core.contracts import Observation, Policy
from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.core.files import sha256_of

_CODE = re.compile(r"[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*:[A-Za-z_]\w*", re.ASCII)
PARTS_OF_CODE = {"policy": 2, "expert": 2, "env": 3}  # module:factory, gymnasium:module:Id
EXAMPLE = "Example: my_pilot:make, where my_pilot.py has a function make() that returns a policy."


def names_code(typed: str) -> bool:
    """Whether what was typed is ``module:factory``, and no file or folder of that name."""
    return _CODE.fullmatch(typed) is not None and not Path(typed).exists()


def refuse_code(introduction: str, recorded: Mapping[str, Any]) -> None:
    """Refuse code that a file names and the user has not typed: files do not decide what runs.

    Args:
        introduction: what the file is, before the setting that names code. recorded: settings that nobody typed.

    Raises:
        InvalidValueError: says what to type by whoever trusts it.
    """
    for name, parts in PARTS_OF_CODE.items():
        value = str(recorded.get(name))
        if names_code(value) if name == "policy" else len(value.split(":")) >= parts:
            said = f"{name}={value}"
            raise InvalidValueError(
                f"{introduction} {said}, which names code, and files do not decide what runs. If you trust it, type it "
                f"too: {said}"
            )


def policy_of(typed: str) -> Policy:
    """Import ``module:factory``, from the working directory too, and return what the factory makes.

    Args:
        typed: by the user; never what a file says.

    Returns:
        The policy; a plain function ``observations -> actions (n, Da)`` is made one. Where it says nothing of its
        ``sha256``, that of the module's file and the factory's name stands for it: what the file imports does not
        count.

    Raises:
        InvalidValueError: there is no such module or factory, it fails, or makes something else.
    """
    if not names_code(typed):
        raise InvalidValueError(f"{typed} does not name code of yours: write module:factory. {EXAMPLE}")
    module, _, name = typed.partition(":")
    try:
        with _working_directory():
            made = getattr(importlib.import_module(module), name)()
    except AerialError:
        raise
    except Exception as error:
        raise InvalidValueError(f"{typed} cannot be made: {type(error).__name__}: {error}. {EXAMPLE}") from error
    if isinstance(made, Policy) or callable(made):
        policy: Any = made if isinstance(made, Policy) else _Function(made)
        source = getattr(sys.modules[module], "__file__", None)
        if source and not hasattr(policy, "sha256"):
            with suppress(AttributeError):  # an object without a dictionary keeps no more
                policy.sha256 = hashlib.sha256(f"{sha256_of(source)} {name}".encode()).hexdigest()
        return policy
    raise InvalidValueError(f"{typed} makes a {type(made).__name__}: neither a policy nor a function. {EXAMPLE}")


class _Function:
    """A function of the observations as a policy."""

    def __init__(self, function: Callable[[Observation], Any]) -> None:
        self._function = function

    def act(self, obs: Observation) -> np.ndarray:
        return np.asarray(self._function(obs), float)

    def reset(self, mask: np.ndarray | None = None) -> None:
        """It has no state."""


@contextmanager
def _working_directory() -> Iterator[None]:
    """Let modules be found where the user stands, as ``python -m`` does."""
    sys.path.insert(0, os.getcwd())
    try:
        yield
    finally:
        sys.path.remove(os.getcwd())
