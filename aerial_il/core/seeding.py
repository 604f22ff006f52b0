"""Randomness that depends on names and seeds alone, never on worker count or call order."""

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from aerial_il.core.errors import InvalidValueError


def episode_rng(robot: str, task: str, purpose: str, seed: int) -> np.random.Generator:
    """Return the generator that decides one random thing about an episode.

    Each purpose has a stream of its own, so that episodes which differ in one of them are alike in all others.

    Args:
        robot, task: registry names.
        purpose: what is drawn, e.g. ``start``.
        seed: non-negative episode seed.

    Returns:
        A PCG64 generator; equal arguments give equal streams on every platform.
    """
    return named_rng(seed, robot, task, purpose)


def named_rng(seed: int, *names: str) -> np.random.Generator:
    """Return an independent stream for a named purpose, e.g. ``named_rng(0, "noise", "expert")``."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([*_words("/".join(names)), int(seed)])))


def restarted(
    rngs: Sequence[np.random.Generator], seeds: np.ndarray, mask: np.ndarray | None, *names: str
) -> tuple[list[np.random.Generator], np.ndarray]:
    """Return the named streams of n worlds, new ones where episodes begin, and where (n,) bool they do.

    Args:
        rngs: those so far; of another number of worlds all begin. seeds: (n,). mask: (n,) bool; None for all.
    """
    fresh = len(rngs) != len(seeds)
    begins = np.ones(len(seeds), bool) if mask is None or fresh else mask
    new = (i for i in range(len(seeds)) if begins[i])
    started = {i: named_rng(int(seeds[i]), *names) for i in new}
    return [started[i] if begins[i] else rngs[i] for i in range(len(seeds))], begins


def seeds_of(seeds: np.ndarray | Sequence[int] | int, n: int) -> np.ndarray:
    """Return the seeds (n,) of n worlds; one integer s stands for s, s + 1, …

    Raises:
        InvalidValueError: neither one integer nor n.
    """
    given = np.asarray(seeds)
    if given.dtype.kind not in "iu":
        raise InvalidValueError(f"seeds are integers from 0 to 2**53 - 1, got {seeds!r}.")
    each = np.array([int(given) + i for i in range(n)]) if given.ndim == 0 else given
    if each.shape != (n,):
        raise InvalidValueError(f"seeds is one integer or has one entry per world, ({n},), got {each.shape}.")
    return each


@contextmanager
def torch_rng(seed: int, *names: str) -> Iterator[None]:
    """Give torch's own generator a stream named like :func:`named_rng`'s, and give back its old state afterwards.

    Initial weights and dropout draw from that generator and take no other, hence this one place that seeds it.
    """
    import torch

    with torch.random.fork_rng():
        torch.manual_seed(int(named_rng(seed, *names).integers(2**63)))
        yield


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Let torch use ``count`` threads within the ``with`` block: results repeat bit for bit at a fixed number only."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _words(text: str) -> list[int]:
    digest = hashlib.sha256(text.encode()).digest()
    return [int.from_bytes(digest[i : i + 4], "little") for i in range(0, 16, 4)]
