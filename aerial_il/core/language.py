"""Instructions as numbers that a policy can see, without a model of language: a hashed bag of words.

Words and pairs of neighbouring words each raise or lower one of a few numbers, which and how a hash says; Chinese is
taken by characters. Wordings that share words are near each other, and nothing has to be downloaded or learned. A
policy is not shown words that it never learned from: what it is told is :func:`understood` as what it did.

Sources: K. Weinberger et al., "Feature hashing for large scale multitask learning", ICML 2009, equation 2; A. Ochiai,
"Zoogeographical studies on the soleoid fishes found in Japan and its neighbouring regions", 1957 (likeness of sets).
"""

import math
import re
import unicodedata
from collections.abc import Iterable
from itertools import pairwise
from zlib import crc32

import numpy as np

SIZE = 128
ALIKE = 0.2  # the least likeness of two texts of one meaning; of the suite's held-out wordings it is 0.25 or more
EMPTY = frozenset(
    {"a", "an", "and", "at", "by", "in", "is", "it", "its", "of", "on", "please", "the", "there", "to", "with"}
    | set("把到的将让请在并使用上")
)  # words that say nothing of a task
FIELD = "instruction"  # of an observation
_FORBIDS = re.compile(r"\W*(?:please\W+|kindly\W+|请)?(?:do not\b|don[’']?t\b|not\b|never\b|[不勿别])")
_TOKEN = re.compile(r"[a-z0-9]+|[\u3400-\u9fff]")


def tokens(text: str) -> list[str]:
    """Return the words of a text that say something, in lower case; Chinese characters one by one."""
    return [word for word in _TOKEN.findall(unicodedata.normalize("NFKC", text).lower()) if word not in EMPTY]


def embedded(text: str) -> np.ndarray:
    """Return (SIZE,) numbers of unit length for a text; zeros for one without words."""
    vector = np.zeros(SIZE)
    for term in _terms(text):
        digest = crc32(term.encode())
        vector[digest % SIZE] += 1.0 if digest & (1 << 31) else -1.0
    length = np.linalg.norm(vector)
    return vector / length if length else vector


def understood(text: str, known: Iterable[str]) -> str | None:
    """Return which of the ``known`` texts is meant by ``text``; None where it is like none, or forbids something new.

    It goes by words alone: an order that shares words with what is known is taken for it, whatever it asks for.
    """
    meant, likeness = nearest(text, known)
    forbids = likeness < 1.0 and _FORBIDS.match(text.lower())
    return None if likeness < ALIKE or forbids else meant


def nearest(text: str, known: Iterable[str]) -> tuple[str, float]:
    """Return which of the ``known`` texts is most like ``text``, the first of equals, and how alike they are, 0 to 1.

    Two texts are as alike as the share of words, and of pairs of neighbours, that they have in common.
    """
    said = {*_terms(text)}

    def likeness(other: str) -> float:
        terms = {*_terms(other)}
        return len(said & terms) / math.sqrt(len(said) * len(terms)) if said and terms else 0.0

    meant = max(known, key=likeness)
    return meant, likeness(meant)


def _terms(text: str) -> list[str]:
    words = tokens(text)
    return [*words, *(f"{one} {other}" for one, other in pairwise(words))]
