"""Flights of the experts, side by side in one animation or one after another as a film."""

from dataclasses import dataclass
from pathlib import Path

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.places import claim_file
from aerial_il.workflows.parts.names import at_least

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
SIZES, PICTURES_A_SECOND = {SIDE_BY_SIDE: (280, 280), ONE_BY_ONE: (540, 960)}, {SIDE_BY_SIDE: 12.5, ONE_BY_ONE: 25.0}


@dataclass(frozen=True, kw_only=True)
class Film:
    """What is shown, and how.

    Attributes:
        flights: who flies what: ROBOT/TASK or ROBOT/TASK/TIER (null: six or twelve of ours).
        out: the animation, .webp, or the film, .mp4.
        size: height and width: of one flight's picture (null: 280,280), or of a film (540,960).
        fps: pictures a second (null: 12.5 of an animation, 25 of a film).
        abreast: flights at once in an animation.
        quality: of an animation's pictures, 0 to 100.
        seconds: length of a film, shared by its flights.
        exposures: of each picture of a film: more make shadows and propellers smoother, and take longer.
        progress: show a progress bar.
    """

    flights: tuple[str, ...] | None = None
    out: str = "docs/film.webp"
    size: tuple[int, int] | None = None
    fps: float | None = None
    abreast: int = 3
    quality: int = 60
    seconds: float = 60.0
    exposures: int = 4
    progress: bool = True

    def __post_init__(self) -> None:
        at_least(self, abreast=1, exposures=1)
        if Path(self.out).suffix not in SIZES:
            raise InvalidValueError(f"out={self.out} ends neither in {SIDE_BY_SIDE} nor in {ONE_BY_ONE}.")
        if wrong := [flight for flight in self.flights or () if flight.count("/") not in (1, 2)]:
            raise InvalidValueError(f"{', '.join(wrong)}: name flights ROBOT/TASK, e.g. ua_quad_arm4/reach.")


def film(settings: Film) -> Path:
    """Fly, draw, and return where the animation or the film is."""
    from aerial_il.core.rendering import require_rendering
    from aerial_il.presentation.films.reel import ReelLook, write_reel
    from aerial_il.presentation.films.side_by_side import Look, write_side_by_side
    from aerial_il.workflows.parts.pilots import expert_flight

    claim_file(settings.out)
    require_rendering(f"out={settings.out}")
    kind = Path(settings.out).suffix
    height, width = settings.size or SIZES[kind]
    fps = settings.fps or PICTURES_A_SECOND[kind]
    flights = settings.flights or (FLIGHTS if kind == SIDE_BY_SIDE else REEL)
    episodes = [expert_flight(*flight.split("/"))[0] for flight in flights]
    if kind == SIDE_BY_SIDE:
        look = Look(height=height, width=width, fps=fps, quality=settings.quality, abreast=settings.abreast)
        return write_side_by_side(settings.out, episodes, look, progress=settings.progress)
    reel = ReelLook(height, width, fps, settings.seconds, settings.exposures, TITLE, SUBTITLE)
    return write_reel(settings.out, episodes, reel, progress=settings.progress)
