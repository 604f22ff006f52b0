"""Show flights of the experts side by side in one small animation, WebP: the one at the top of the README.

Each flies the first of a few seeds that it solves in calm air; all play in real time, a few at once, then the next.

Example: aerial-il film out=docs/film.webp
Example: aerial-il film flights=[quad/hover,ua_quad_arm4/reach] abreast=2 out=two.webp
"""

from __future__ import annotations

from dataclasses import dataclass

from aerial_il.cli.configuration.keys import at_least, key
from aerial_il.core.errors import InvalidValueError

FLIGHTS = [
    *("ua_quad_arm4/pick_place", "fa_hexa_arm4/open_door", "big_four_z1/insert_peg"),
    *("mini_quad_gripper/press_button", "ua_quad_arm4/push_slider", "big_four_z1/rotate_valve"),
]


@dataclass
class Config:
    flights: list[str] = key(FLIGHTS, "who flies what: ROBOT/TASK, from left to right, round after round")
    abreast: int = key(3, "flights at once")
    out: str = key("docs/film.webp", "the animation")
    size: list[int] = key([280, 280], "height and width of one flight's picture")
    fps: float = key(12.5, "pictures a second")
    quality: int = key(60, "of the pictures, 0 to 100")
    progress: bool = key(True, "show a progress bar")

    def __post_init__(self) -> None:
        at_least(self, abreast=1)
        if len(self.size) != 2:
            raise InvalidValueError(f"size={self.size} is not a height and a width, e.g. size=[280,280].")
        if wrong := [flight for flight in self.flights if flight.count("/") != 1]:
            raise InvalidValueError(f"{', '.join(wrong)}: name flights ROBOT/TASK, e.g. ua_quad_arm4/reach.")


def run(config: Config) -> None:
    """Fly, draw, and say where the animation is."""
    from aerial_il.cli.flights.pilots import expert_flight
    from aerial_il.core.rendering import require_rendering
    from aerial_il.evaluation.films.side_by_side import Look, write_side_by_side

    require_rendering(f"out={config.out}")
    height, width = config.size
    look = Look(height=height, width=width, fps=config.fps, quality=config.quality, abreast=config.abreast)
    cells = [flight.split("/") for flight in config.flights]
    episodes = [expert_flight(robot, task)[0] for robot, task in cells]
    path = write_side_by_side(config.out, episodes, look, progress=config.progress)
    print(f"Film: {path}, {path.stat().st_size / 1000:.0f} kB")
