"""A digest over what an episode says, so that no change passes that a checksum might let through."""

import hashlib
import json
from collections.abc import Mapping

import numpy as np


class ContentDigest:
    """Collects SHA-256 sums of topics, metadata and attachments; independent of chunks and compression."""

    def __init__(self) -> None:
        self._topics: dict[str, hashlib._Hash] = {}

    def update(self, topic: str, records: bytes | np.ndarray) -> None:
        """Add message records of ``topic``, in order (contiguous); how they are split over calls does not matter."""
        self._topics.setdefault(topic, hashlib.sha256()).update(records)

    def hexdigest(self, metadata: Mapping[str, Mapping[str, str]], attachments: Mapping[str, bytes]) -> str:
        """Return the digest of all topics so far together with ``metadata`` and ``attachments``."""
        tree = {
            "topics": {name: topic.hexdigest() for name, topic in self._topics.items()},
            "metadata": metadata,
            "attachments": {name: hashlib.sha256(data).hexdigest() for name, data in attachments.items()},
        }
        return hashlib.sha256(json.dumps(tree, sort_keys=True).encode()).hexdigest()
