"""Options that both Gymnasium faces take: a scenario's, by the names of :func:`aerial_il.load`, and how to render it.

Their defaults are those of :class:`Scenario` and :class:`Presentation`, and are written nowhere else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypedDict

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.suite.scenario import Scenario

RENDER_MODES = ("rgb_array",)
SCENARIO = {"tier": "tier_name"} | {name: name for name in ("action", "cameras", "image_size", "controller")}


class FaceOptions(TypedDict, total=False):
    """Keyword arguments of ``gymnasium.make`` and ``gymnasium.make_vec``; each may be left out.

    Attributes:
        tier, action, cameras, image_size, controller: as for :func:`aerial_il.load`.
        terminate_on_success, render_mode, render_camera, render_size: see :class:`Presentation`.
    """

    tier: str
    action: str
    cameras: Sequence[str]
    image_size: tuple[int, int]
    controller: str
    terminate_on_success: bool
    render_mode: str | None
    render_camera: str
    render_size: tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class Presentation:
    """What a face shows of a scenario.

    Attributes:
        terminate_on_success: end an episode when its task is done; otherwise only a crash or a lost object ends it.
        render_mode: None or ``rgb_array``. render_camera: which camera. render_size: (height, width), pixels.

    Raises:
        InvalidValueError: unknown mode.
    """

    terminate_on_success: bool = False
    render_mode: str | None = None
    render_camera: str = "scene"
    render_size: tuple[int, int] = (240, 320)

    def __post_init__(self) -> None:
        if self.render_mode not in (None, *RENDER_MODES):
            raise InvalidValueError(f"render_mode is None or 'rgb_array', got {self.render_mode!r}.")


def read_options(robot: str, task: str, options: Mapping[str, Any]) -> tuple[Scenario, Presentation]:
    """Return the scenario that ``options`` of a cell describe, and how it is shown.

    Raises:
        UnknownNameError: an option that there is not, or a name in one. InvalidValueError: a value out of range.
        CellError: the robot cannot do the task.
    """
    known = FaceOptions.__annotations__
    for name in options.keys() - known.keys():
        raise UnknownNameError("option", name, known)
    scenario = {SCENARIO[name]: value for name, value in options.items() if name in SCENARIO}
    shown = {name: value for name, value in options.items() if name not in SCENARIO}
    found, presentation = Scenario(robot, task, **scenario), Presentation(**shown)
    found.camera(presentation.render_camera)
    return found, presentation
