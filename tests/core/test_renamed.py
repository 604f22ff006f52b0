"""An old key leads to a new one, never to itself or to another old one."""

from __future__ import annotations

from aerial_il.core.renamed import MOVED


def test_no_key_leads_to_itself_or_to_another_old_one() -> None:
    assert not set(MOVED) & {new for places in MOVED.values() for new in places}
