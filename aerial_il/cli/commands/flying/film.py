"""Show flights of the experts: side by side in one small animation, WebP, or one after another as a film, MP4.

Each flies the first of a few seeds that it solves. Side by side all play in real time, a few at once, then the next. A
film follows each flight from a camera of its own, with the trails of tool (orange) and base (blue), wind (light blue)
and contact force (red) as arrows. It lasts ``seconds``: flights too long for their share of the time play up to twice
as fast, and if all are short, all play slower, at half speed at most.

Example: aerial-il film out=docs/film.webp
Example: aerial-il film out=film.mp4 size=[1080,1920]
Example: aerial-il film flights=[quad/hover,ua_quad_arm4/reach/gusts] abreast=2 out=two.webp
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from aerial_il.cli.configuration.keys import at_least, key
from aerial_il.core.errors import InvalidValueError

FLIGHTS = [
    *("ua_quad_arm4/pick_place", "fa_hexa_arm4/open_door", "big_four_z1/insert_peg"),
    *("mini_quad_gripper/press_button", "ua_quad_arm4/push_slider", "big_four_z1/rotate_valve"),
]
REEL = [
    *("quad/take_off", "ua_quad_arm4/pick_place", "fa_hexa_arm4/open_door/gusts", "big_four_z1/insert_peg"),
    *("mini_quad_gripper/press_button", "fa_hexa_arm4/pull_lever", "ua_quad_arm4/track", "z1/pick_place"),
    *("fa_hexa_arm4/inspect_contact", "ua_quad_arm4/push_slider/gusts", "big_four_z1/rotate_valve", "quad/land/gusts"),
]
TITLE, SUBTITLE = "Aerial IL", "imitation learning on aerial manipulators"
SIDE_BY_SIDE, ONE_BY_ONE = ".webp", ".mp4"
SIZES, PICTURES_A_SECOND = {SIDE_BY_SIDE: [280, 280], ONE_BY_ONE: [540, 960]}, {SIDE_BY_SIDE: 12.5, ONE_BY_ONE: 25.0}


@dataclass
class Config:
    flights: list[str] | None = key(None, "who flies what: ROBOT/TASK or ROBOT/TASK/TIER (null: six or twelve of ours)")
    out: str = key("docs/film.webp", "the animation, .webp, or the film, .mp4")
    size: list[int] | None = key(
        None, "height and width: of one flight's picture (null: 280,280), or of a film (540,960)"
    )
    fps: float | None = key(None, "pictures a second (null: 12.5 of an animation, 25 of a film)")
    abreast: int = key(3, "flights at once in an animation")
    quality: int = key(60, "of an animation's pictures, 0 to 100")
    seconds: float = key(60.0, "length of a film, shared by its flights")
    exposures: int = key(4, "of each picture of a film: more make shadows and propellers smoother, and take longer")
    progress: bool = key(True, "show a progress bar")

    def __post_init__(self) -> None:
        at_least(self, abreast=1, exposures=1)
        if Path(self.out).suffix not in SIZES:
            raise InvalidValueError(f"out={self.out} ends neither in {SIDE_BY_SIDE} nor in {ONE_BY_ONE}.")
        if self.size is not None and len(self.size) != 2:
            raise InvalidValueError(f"size={self.size} is not a height and a width, e.g. size=[280,280].")
        if wrong := [flight for flight in self.flights or () if flight.count("/") not in (1, 2)]:
            raise InvalidValueError(f"{', '.join(wrong)}: name flights ROBOT/TASK, e.g. ua_quad_arm4/reach.")


def run(config: Config) -> None:
    """Fly, draw, and say where the animation or the film is."""
    from aerial_il.core.rendering import require_rendering
    from aerial_il.presentation.films.reel import ReelLook, write_reel
    from aerial_il.presentation.films.side_by_side import Look, write_side_by_side
    from aerial_il.workflows.parts.pilots import expert_flight

    require_rendering(f"out={config.out}")
    kind = Path(config.out).suffix
    height, width = config.size or SIZES[kind]
    fps = config.fps or PICTURES_A_SECOND[kind]
    if kind == SIDE_BY_SIDE:
        look = Look(height=height, width=width, fps=fps, quality=config.quality, abreast=config.abreast)
        episodes = [expert_flight(*flight.split("/"))[0] for flight in config.flights or FLIGHTS]
        path = write_side_by_side(config.out, episodes, look, progress=config.progress)
    else:
        reel = ReelLook(height, width, fps, config.seconds, config.exposures, TITLE, SUBTITLE)
        episodes = [expert_flight(*flight.split("/"))[0] for flight in config.flights or REEL]
        path = write_reel(config.out, episodes, reel, progress=config.progress)
    print(f"Film: {path}, {path.stat().st_size / 1000:.0f} kB")
