"""A batch environment around another one, to change a little of what it answers."""

from typing import Any

from aerial_il.core.contracts import BatchEnv

_Anything: Any = object  # to who checks types it has all that is asked of it


class BatchEnvWrapper(_Anything):
    """Passes everything on; subclasses override what they change.

    Args:
        env: the environment inside.
    """

    def __init__(self, env: BatchEnv) -> None:
        self.env = env

    def __getattr__(self, name: str) -> Any:
        if name == "env":  # not there yet, as in a copy that is being made
            raise AttributeError(name)
        return getattr(self.env, name)
