"""Old names of keys and the new ones: data by which old words are answered."""

from __future__ import annotations

from collections.abc import Mapping

#: Settings of algorithms, as dotted paths below ``algorithm`` (in a run's configuration: below ``settings``).
ALGORITHM_KEYS: Mapping[str, str] = {}
