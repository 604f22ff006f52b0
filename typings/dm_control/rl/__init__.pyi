# dm_control is untyped: what a type checker infers from its abstract methods (they return None) is wrong.
from typing import Any

def __getattr__(name: str) -> Any: ...
