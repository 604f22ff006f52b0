# MuJoCo's bindings are compiled and ship no types: their attributes are unknown to a type checker, not wrong.
from typing import Any

def __getattr__(name: str) -> Any: ...
