"""An old name leads to a new one, never to itself or to another old one."""

from __future__ import annotations

from aerial_il.core.renamed import ALGORITHM_KEYS


def test_no_name_leads_to_itself_or_to_another_old_one() -> None:
    assert not set(ALGORITHM_KEYS) & set(ALGORITHM_KEYS.values())
