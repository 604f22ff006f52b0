"""What must hold for a policy to fly a robot over a link; where it does not, the robot hovers."""

from dataclasses import dataclass

from aerial_il.core.checks import make_tuples, require_positive
from aerial_il.core.errors import InvalidValueError


@dataclass(frozen=True, kw_only=True)
class Guard:
    """When a policy is not asked, and where the robot may be.

    Attributes:
        stale_ms: without a new reading for longer, set points are held back, so that the robot hovers.
        fence: corners of the box that the base must stay in, m: low x, y, z, high x, y, z.
    """

    stale_ms: float = 80.0
    fence: tuple[float, ...] = (-3.5, -3.5, 0.0, 3.5, 3.5, 3.5)

    def __post_init__(self) -> None:
        make_tuples(self)
        require_positive(self, "stale_ms")
        low, high = self.fence[:3], self.fence[3:]
        if len(self.fence) != 6 or not all(a < b for a, b in zip(low, high, strict=True)):
            raise InvalidValueError(
                f"fence is {list(self.fence)}; it must be six numbers, each of the first three below its partner, "
                "e.g. [-2,-2,0.2,2,2,3]."
            )
