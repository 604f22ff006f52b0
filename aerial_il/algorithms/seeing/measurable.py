"""Whether anything can be measured in the images that an estimator is to learn from, and is labelled as it is."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.scene_gate import compiled
from aerial_il.core.specs import EnvSpec, camera_name
from aerial_il.data.episode import Episode
from aerial_il.policies.perception.cameras import Camera

ESTIMATION = "estimation"  # component of a tier


def check_labels(spec: EnvSpec) -> None:
    """Refuse an environment in which frames would be labelled with errors.

    Raises:
        InvalidValueError: says how to do without them.
    """
    if ESTIMATION in spec.disturbances:
        raise InvalidValueError(
            f"In tier {spec.tier} objects are shown late and with errors, and frames would be labelled with them. Let "
            f"it look and fly without: flight_tier={spec.tier}-{ESTIMATION}."
        )


def check_cameras(demo: Episode, model: mujoco.MjModel, images: Sequence[str]) -> None:
    """Refuse demonstrations that were taken through other cameras than the robot has now.

    Raises:
        InvalidValueError: names the camera, and how it differs; or the image that is not one to measure in.
    """
    recorded = compiled(demo.model_xml)
    for image in images:
        if not demo.spec.observation[image].is_colour:
            raise InvalidValueError(f"algorithm=perception looks at colour images, and {image!r} has no colours.")
        Camera.of(demo.spec, image)
        name = camera_name(image)
        then, now = (each.cam(name) for each in (recorded, model))
        same = {key: np.allclose(getattr(then, key), getattr(now, key), atol=1e-6) for key in ("fovy", "pos", "quat")}
        if not all(same.values()):
            differing = ", ".join(f"{k} {getattr(then, k)} != {getattr(now, k)}" for k in same if not same[k])
            raise InvalidValueError(
                f"The demonstrations were recorded through another camera {name!r} than {demo.spec.robot} has now "
                f"({differing}): nothing can be measured in their images. Record them again: aerial-il collect."
            )
