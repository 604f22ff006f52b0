"""An estimate of the bandwidth to a page, by how long pictures take to be shown; slow links get smaller pictures."""

import time
from collections.abc import Callable

from aerial_il.teleop.web.film import THRIFT

SLOW_S, QUICK_S = 0.18, 0.06  # a picture that takes longer asks for smaller ones, a shorter time for larger ones
PATIENCE_S, LONG_PATIENCE_S = 0.4, 5.0  # between two changes to smaller, and to larger ones


class Link:
    """Chooses the thrift of pictures for one page.

    Args:
        now: a clock in s, for tests.
    """

    def __init__(self, now: Callable[[], float] = time.perf_counter) -> None:
        self._now, self._changed, self.thrift = now, now(), 0
        self._sent: dict[int, float] = {}

    def send(self, number: int) -> None:
        """Note that picture ``number`` is on its way."""
        self._sent[number] = self._now()

    def arrive(self, number: int) -> None:
        """Note that it was shown, and choose."""
        now = self._now()
        sent = self._sent.get(number)
        self._sent = {later: at for later, at in self._sent.items() if later > number}
        if sent is None:
            return
        took, since = now - sent, now - self._changed
        if took > SLOW_S and since > PATIENCE_S and self.thrift < len(THRIFT) - 1:
            self.thrift, self._changed = self.thrift + 1, now
        elif took < QUICK_S and since > LONG_PATIENCE_S and self.thrift > 0:
            self.thrift, self._changed = self.thrift - 1, now
