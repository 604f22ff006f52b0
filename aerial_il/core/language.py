"""Instructions as numbers that a policy can see, without a model of language: a hashed bag of words.

Words and pairs of neighbouring words each raise or lower one of a few numbers, which and how a hash says; Chinese is
taken by characters. Wordings that share words are near each other, and nothing has to be downloaded or learned.

Source: K. Weinberger et al., "Feature hashing for large scale multitask learning", ICML 2009, equation 2.
"""

import re
import unicodedata
from itertools import pairwise
from zlib import crc32

import numpy as np

SIZE = 128
EMPTY = frozenset(
    {"a", "an", "and", "at", "by", "in", "is", "it", "its", "of", "on", "please", "the", "there", "to", "with"}
    | set("把到的将让请在并使用上")
)  # words that say nothing of a task
FIELD = "instruction"  # of an observation
_TOKEN = re.compile(r"[a-z0-9]+|[\u3400-\u9fff]")


def tokens(text: str) -> list[str]:
    """Return the words of a text that say something, in lower case; Chinese characters one by one."""
    return [word for word in _TOKEN.findall(unicodedata.normalize("NFKC", text).lower()) if word not in EMPTY]


def embedded(text: str) -> np.ndarray:
    """Return (SIZE,) numbers of unit length for a text; zeros for one without words."""
    words, vector = tokens(text), np.zeros(SIZE)
    for term in (*words, *(f"{one} {other}" for one, other in pairwise(words))):
        digest = crc32(term.encode())
        vector[digest % SIZE] += 1.0 if digest & (1 << 31) else -1.0
    length = np.linalg.norm(vector)
    return vector / length if length else vector
