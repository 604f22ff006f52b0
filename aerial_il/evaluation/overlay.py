"""One frame of a flight video: camera views side by side above a strip that says what is seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont

STRIP_HEIGHT = 48
MARGIN = 12
INK, MUTED, GROUND = (236, 240, 243), (148, 160, 170), (17, 22, 28)
COLOURS = {"success": (45, 190, 160), "crash": (244, 132, 68), "timeout": (226, 184, 74), "": (96, 165, 220)}
VERDICTS = {"success": "success", "crash": "crash", "timeout": "out of time"}


@dataclass(frozen=True)
class Caption:
    """What the strip says.

    Attributes:
        title: what is flown, e.g. ``pick_place · ua_quad_arm4 · seed 10007``.
        time_s: simulated time.
        progress: share of the clip that has passed, in [0, 1].
        phase: what the policy is doing, if it says so.
        subtasks: sub-task -> done so far.
        end: how the episode ended, empty while it flies.
    """

    title: str
    time_s: float
    progress: float
    phase: str
    subtasks: Mapping[str, bool]
    end: str = ""


def compose(views: Mapping[str, np.ndarray], caption: Caption) -> np.ndarray:
    """Return one frame.

    Args:
        views: camera name -> (H, W, 3) uint8, all of one height.
        caption: what the strip says.

    Returns:
        (H + 48, sum of W, 3) uint8.
    """
    picture = np.concatenate(list(views.values()), axis=1)
    height, width = picture.shape[:2]
    frame = Image.new("RGB", (width, height + STRIP_HEIGHT), GROUND)
    frame.paste(Image.fromarray(picture))
    draw = ImageDraw.Draw(frame, "RGBA")
    _label_views(draw, views)
    _draw_strip(draw, caption, top=height, width=width)
    return np.asarray(frame)


def _label_views(draw: ImageDraw.ImageDraw, views: Mapping[str, np.ndarray]) -> None:
    left = 0
    for name, view in views.items():
        box = draw.textbbox((left + 14, 10), name, font=_font(12))
        draw.rounded_rectangle((box[0] - 6, box[1] - 4, box[2] + 6, box[3] + 4), radius=5, fill=(*GROUND, 150))
        draw.text((left + 14, 10), name, font=_font(12), fill=INK)
        left += view.shape[1]


def _draw_strip(draw: ImageDraw.ImageDraw, caption: Caption, *, top: int, width: int) -> None:
    colour, right = COLOURS[caption.end], width - MARGIN
    draw.rectangle((0, top, width * caption.progress, top + 2), fill=colour)
    clock = f"{caption.time_s:.2f} s"
    verdict = f"{VERDICTS[caption.end]}  {clock}" if caption.end else clock
    draw.text((MARGIN, top + 8), caption.title, font=_font(13), fill=INK)
    draw.text((right, top + 8), verdict, font=_font(13), fill=colour if caption.end else INK, anchor="ra")
    draw.text((right, top + 28), caption.phase.replace("_", " "), font=_font(12), fill=MUTED, anchor="ra")
    left = float(MARGIN)
    for name, done in caption.subtasks.items():
        left = _draw_subtask(draw, name, done, left=left, top=top + 28)


def _draw_subtask(draw: ImageDraw.ImageDraw, name: str, done: bool, *, left: float, top: int) -> float:
    """Draw a dot, filled once done, and the name; return where the next one starts."""
    dot = (left + 1, top + 3, left + 10, top + 12)
    draw.ellipse(dot, fill=COLOURS["success"] if done else None, outline=COLOURS["success"] if done else MUTED)
    text = name.replace("_", " ")
    draw.text((left + 16, top), text, font=_font(12), fill=INK if done else MUTED)
    return left + 16 + draw.textlength(text, font=_font(12)) + 18


@cache
def _font(size: int) -> ImageFont.ImageFont | ImageFont.FreeTypeFont:
    return ImageFont.load_default(size)
