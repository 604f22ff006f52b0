"""Which runs are evaluated before their first step: those that start from a policy, and could lose what it can do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def is_judged_first(settings: Any, inputs: Mapping[str, str]) -> bool:
    """Whether a run of these settings and inputs starts from a policy that flies already."""
    return "prior" in inputs or getattr(settings, "bc_pretrain_steps", 0) > 0
