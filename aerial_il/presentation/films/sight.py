"""What a policy sees while it flies: the images of its cameras, with where it takes things to be drawn in."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from PIL import Image, ImageDraw

from aerial_il.core.contracts import Observation
from aerial_il.policies.parts.flying import FlyingPolicy
from aerial_il.policies.parts.vision import FAR_M
from aerial_il.policies.perception.cameras import Camera
from aerial_il.policies.perception.policy import PerceivingPolicy
from aerial_il.policies.perception.targets import PLACE
from aerial_il.presentation.films.overlay import INK

ESTIMATES = ((255, 64, 129), (0, 229, 255), (255, 214, 0), (118, 255, 3), (213, 0, 249), (255, 145, 0))
TRUTH = INK
SIDE = 0.02  # of the square around the truth, by the picture's height
LEAST = 0.012  # radius of the circle around an estimate, which holds one deviation


class Sight:
    """The images that a policy is shown in one world, as a picture.

    Args:
        policy: looks at images; where it estimates, a copy of it does so again.
    """

    def __init__(self, policy: FlyingPolicy) -> None:
        self.images, self._spec = policy.interface.layout.images, policy.spec.observation
        self._policy = policy.fresh() if isinstance(policy, PerceivingPolicy) else None
        self._obs: dict[str, np.ndarray] = {}
        self._past = list[dict[str, np.ndarray]]()  # its states so far
        self._estimates: Mapping[str, np.ndarray] = {}

    def look(self, obs: Observation) -> None:
        """Take in what world 0 shows, at the start of an episode and after each of its steps."""
        self._obs = {name: values[:1] for name, values in obs.items()}
        self._past.append({name: self._obs[name] for name in self._spec.state_names if name in self._obs})
        if self._policy is not None:
            self._estimates = self._policy.estimate(self._obs)

    def picture(self, height: int) -> np.ndarray:
        """Return all images below each other, (height, W, 3) uint8, at the height of a film.

        A circle is an estimate with one deviation, a square the truth.
        """
        each = height // len(self.images)
        pictures = [self._image(name, each) for name in self.images]
        width = 2 * (max(picture.width for picture in pictures) // 2)
        whole = Image.new("RGB", (width, height))
        for k, picture in enumerate(pictures):
            whole.paste(picture, (0, k * each))
        return np.asarray(whole)

    def _image(self, name: str, height: int) -> Image.Image:
        shown = self._obs[name][0]
        size = (round(height * shown.shape[1] / shown.shape[0]), height)
        if self._spec[name].is_depth:
            shown = (255.0 * np.clip(shown / FAR_M, 0.0, 1.0)).astype(np.uint8)
        picture = Image.fromarray(shown).resize(size, Image.Resampling.NEAREST)
        if self._policy is not None:
            camera = next(each for each in self._policy.eyes.cameras if each.image == name)
            self._mark(ImageDraw.Draw(picture), camera, size)
        return picture

    def _mark(self, draw: ImageDraw.ImageDraw, camera: Camera, size: tuple[int, int]) -> None:
        assert self._policy is not None
        sure, taken = self._policy.deviations, self._spec[camera.image].taken_at(len(self._past) - 1)
        then = self._past[int(taken)]
        places = [target for target in self._policy.eyes.targets.estimated if target.kind == PLACE]
        for k, place in enumerate(places):
            found = self._pixel(camera, then, self._estimates[place.field], size)
            if found is not None:
                (x, y), per_metre = found
                radius, colour = max(LEAST * size[1], sure[place.field][0] * per_metre), ESTIMATES[k % len(ESTIMATES)]
                draw.ellipse((x - radius, y - radius, x + radius, y + radius), outline=colour, width=2)
            known = {*place.parts} <= {*then}
            if known and (found := self._pixel(camera, then, place.values(then), size)) is not None:
                (x, y), half = found[0], SIDE * size[1]
                draw.rectangle((x - half, y - half, x + half, y + half), outline=TRUTH)

    def _pixel(
        self, camera: Camera, then: Observation, place: np.ndarray, size: tuple[int, int]
    ) -> tuple[tuple[float, float], float] | None:
        """Return where a place (1, 3) lies in a picture, and how many pixels a metre has there; None outside.

        Args:
            then: what the robot knew of itself when it was taken.
        """
        own = camera.pose(then).seen(place)
        if not camera.in_view(own)[0]:
            return None
        across, up, log_depth = camera.project(own)[0]
        per_metre = 0.5 * size[1] / (camera.slope * np.exp(log_depth))
        return (0.5 * size[0] * (1.0 + across), 0.5 * size[1] * (1.0 - up)), per_metre
