"""What is measured in the images that an estimator is to learn from, and whether that can be, and is labelled truly."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec, camera_name
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.perception.cameras import Camera, changed_cameras
from aerial_il.policies.perception.targets import Targets

ESTIMATION = "estimation"  # component of a tier
END_TO_END = ("encoder", "crop", "image_features")  # settings of eyes that are learned with what acts


def check_labels(spec: EnvSpec, remedy: str) -> None:
    """Refuse an environment in which frames would be labelled with errors.

    Args:
        spec: of what they are labelled by. remedy: what to do, said of ``{tier}``, the same without errors.

    Raises:
        InvalidValueError: says it.
    """
    if ESTIMATION in spec.disturbances:
        raise InvalidValueError(
            f"In tier {spec.tier} objects are shown late and with errors, and images would be labelled with them. "
            + remedy.format(tier=f"{spec.tier}-{ESTIMATION}")
        )


def check_one_task(demos: Iterable[Episode], who: str) -> None:
    """Refuse demonstrations of several tasks, each of which has things of its own to see.

    Raises:
        InvalidValueError: names them.
    """
    if len(tasks := sorted({demo.spec.task for demo in demos})) > 1:
        raise InvalidValueError(
            f"{who} learns to see what one task has, and these are demonstrations of {', '.join(tasks)}. Train one "
            f"run of each, e.g. of: aerial-il filter PATH out=datasets/{tasks[0]} where=\"task == '{tasks[0]}'\""
        )


def check_states(demos: Iterable[Episode]) -> None:
    """Refuse demonstrations that cannot be drawn anew, as formats of others keep no states of the simulator.

    Raises:
        InvalidValueError: names one.
    """
    if lacking := next((demo.uid for demo in demos if not demo.states.shape[1]), None):
        raise InvalidValueError(
            f"Episode {lacking} has no states of the simulator, from which frames are drawn anew: learn from the "
            "recordings themselves, as aerial-il collect writes them, or from images to actions (policy=flow "
            "observations=onboard)."
        )


def check_cameras(demos: Iterable[Episode], images: Sequence[str]) -> None:
    """Refuse demonstrations that were taken through other cameras than the robot has now.

    Raises:
        InvalidValueError: names the camera, and how it differs; or the image that is not one to measure in.
    """
    for demo in {demo.model_xml: demo for demo in demos}.values():
        for image in images:
            if not demo.spec.observation[image].is_colour:
                raise InvalidValueError(f"It is measured in colour images, and {image!r} has no colours.")
            Camera.of(demo.spec, image)
        if changed := changed_cameras(demo.model_xml, demo.spec.robot, [camera_name(image) for image in images]):
            raise InvalidValueError(
                f"The demonstrations were recorded through other cameras than {demo.spec.robot} has now ({changed}): "
                "nothing can be measured in their images. Record them again: aerial-il collect."
            )


def check_eyes(policy: PolicySettings) -> None:
    """Refuse settings of eyes that are learned end to end: beside an estimator they would do nothing.

    Raises:
        InvalidValueError: names the setting.
    """
    for each in fields(policy):
        if each.name in END_TO_END and getattr(policy, each.name) != each.default:
            raise InvalidValueError(
                f"policy.{each.name} is of policies that go from images to actions; algorithm=perception has networks "
                "of its own: see algorithm.width."
            )


def looked_for(demos: Sequence[Episode], state: PolicySettings) -> Targets:
    """Return what is to be estimated for a policy of the state.

    Raises:
        InvalidValueError: nothing varies in the demonstrations.
    """
    spec = demos[0].spec
    targets = Targets.of(spec.observation, [demo.obs for demo in demos], Layout.of(spec, state).names)
    if not targets.estimated:
        raise InvalidValueError(
            f"In these {len(demos)} demonstrations nothing varies that has to be looked for in {spec.task}, so that "
            "there is nothing to learn to see: record more, of other seeds."
        )
    return targets
