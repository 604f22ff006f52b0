"""One frame of a flight video: camera views side by side above a strip that says what is seen."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from aerial_il.presentation.pages.page import END_WORDS

STRIP_HEIGHT, MARGIN, TITLE, TEXT = 48, 12, 13, 12  # pixels of a frame of 640; wider ones are shown smaller
SCALES = 0.84, 1.4
INK, MUTED, BACKGROUND = (236, 240, 243), (148, 160, 170), (17, 22, 28)
COLOURS = {
    "success": (45, 190, 160),
    "crash": (244, 132, 68),
    "dropped": (196, 120, 214),
    "timeout": (226, 184, 74),
    "": (96, 165, 220),
}


@dataclass(frozen=True)
class Caption:
    """The content of the strip.

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
        (H + strip_height(sum of W), sum of W, 3) uint8.
    """
    picture = np.concatenate(list(views.values()), axis=1)
    height, width = picture.shape[:2]
    frame = Image.new("RGB", (width, height + strip_height(width)), BACKGROUND)
    frame.paste(Image.fromarray(picture))
    draw = ImageDraw.Draw(frame, "RGBA")
    _label_views(draw, views, _scale(width))
    _draw_strip(draw, caption, top=height, width=width)
    return np.asarray(frame)


def strip_height(width: int) -> int:
    """Return the height of the strip below a picture of ``width``, in whole pairs of pixels, as video needs."""
    return 2 * round(0.5 * STRIP_HEIGHT * _scale(width))


def _scale(width: int) -> float:
    return min(SCALES[1], max(SCALES[0], width / 640))


def _label_views(draw: ImageDraw.ImageDraw, views: Mapping[str, np.ndarray], scale: float) -> None:
    left, face = 0.0, font(round(TEXT * scale))
    for name, view in views.items():
        place = (left + 14 * scale, 10 * scale)
        x0, y0, x1, y1 = draw.textbbox(place, name, font=face)
        draw.rounded_rectangle((x0 - 6, y0 - 4, x1 + 6, y1 + 4), radius=5, fill=(*BACKGROUND, 150))
        draw.text(place, name, font=face, fill=INK)
        left += view.shape[1]


def _draw_strip(draw: ImageDraw.ImageDraw, caption: Caption, *, top: int, width: int) -> None:
    scale, colour = _scale(width), COLOURS[caption.end]
    right, upper, lower = width - MARGIN * scale, top + 8 * scale, top + 28 * scale
    draw.rectangle((0, top, width * caption.progress, top + 2), fill=colour)
    title, text = font(round(TITLE * scale)), font(round(TEXT * scale))
    clock = f"{caption.time_s:.2f} s"
    verdict = f"{END_WORDS[caption.end]}  {clock}" if caption.end else clock
    draw.text((MARGIN * scale, upper), caption.title, font=title, fill=INK)
    draw.text((right, upper), verdict, font=title, fill=colour if caption.end else INK, anchor="ra")
    draw.text((right, lower), caption.phase.replace("_", " "), font=text, fill=MUTED, anchor="ra")
    left = MARGIN * scale
    for name, done in caption.subtasks.items():
        left = _draw_subtask(draw, name, done, left=left, top=lower, scale=scale)


def _draw_subtask(draw: ImageDraw.ImageDraw, name: str, done: bool, *, left: float, top: float, scale: float) -> float:
    """Draw a dot, filled once done, and the name; return where the next one starts."""
    dot, face = (left + 1, top + 3 * scale, left + 9 * scale + 1, top + 12 * scale), font(round(TEXT * scale))
    draw.ellipse(dot, fill=COLOURS["success"] if done else None, outline=COLOURS["success"] if done else MUTED)
    text = name.replace("_", " ")
    draw.text((left + 15 * scale, top), text, font=face, fill=INK if done else MUTED)
    return left + 33 * scale + draw.textlength(text, font=face)


@cache
def font(size: int) -> ImageFont.ImageFont | ImageFont.FreeTypeFont:
    return ImageFont.load_default(size)
