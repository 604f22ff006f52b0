"""The environment, expert and collector that an algorithm which flies while it learns is handed.

The environment is that of its demonstrations; an algorithm that needs none flies in the one that is named.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import closing, contextmanager, nullcontext
from typing import TYPE_CHECKING, Any

from aerial_il.data.reading import AS_IT_SAYS, Reading

if TYPE_CHECKING:
    from aerial_il.core.contracts import Algorithm, Policy
    from aerial_il.core.specs import EnvSpec
    from aerial_il.workflows.parts.environments import EnvironmentReference

log = logging.getLogger(__name__)

FORFEITED = (
    "Success ends an episode here, and with it the environment's reward for every further step: to hover beside the "
    "goal may return more than to succeed. Train with episodes of a fixed length (horizon=N steps of 20 ms), or with "
    "algorithm.reward=sparse."
)


@contextmanager
def training_resources(
    algorithm: Algorithm,
    dataset: str | None,
    *,
    reference: EnvironmentReference | None = None,
    images: tuple[str, ...],
    expert: str | None,
    tier: str | None,
    num_envs: int | None,
    threads: int,
    port: int = 8642,
    reading: Reading = AS_IT_SAYS,
) -> Iterator[dict[str, Any]]:
    """Yield what ``algorithm.train`` is to be handed besides data, by name; nothing where it only learns.

    Args:
        algorithm: its attribute ``needs`` names what it wants: ``env``, ``expert``, ``collect``.
        dataset: folder of the demonstrations, which say what environment they come from.
        reference: where to fly without any; beside them, what the user typed of theirs.
        images: camera fields that the policy sees.
        expert: as the user typed it: file of an expert from outside, ``module:factory`` of the user's own code,
            ``human`` for a person on the page, ``driver`` for a model of one; None for the task's own.
        tier: how rough the air is; None as in the demonstrations.
        num_envs: worlds flown at once; None for the algorithm's ``worlds``.
        threads: of the simulation, or processes of external environments; 0 for all cores.
        port: of a person's page.
        reading: answers to what the format of the dataset does not say.

    Raises:
        UnknownNameError: the task has no expert.
        InvalidValueError: an environment from outside without one, or nothing says where to fly.
    """
    needs = algorithm.needs
    if not needs:
        yield {}
        return
    from aerial_il.algorithms.online.problem import forfeits_by_success
    from aerial_il.collection.collect import collect
    from aerial_il.data.dataset import open_dataset
    from aerial_il.workflows.parts.environments import EnvironmentReference, reference_of
    from aerial_il.workflows.parts.page import OPERATORS, operator

    by_hand = expert in OPERATORS
    scripted = "expert" in needs and not by_hand
    typed = reference.env if reference else None
    spec = None if dataset is None else open_dataset(dataset, **reading.answers, states=False).spec
    asked = _expert(spec, expert, typed) if spec and scripted else None
    where = reference_of(spec, images=images, typed=typed) if spec else reference or EnvironmentReference()
    worlds = 1 if by_hand else num_envs or algorithm.worlds
    env = where.load(num_envs=worlds, threads=1 if by_hand else threads, tier=tier)
    if forfeits_by_success(algorithm) and env.ends_at_success:
        log.warning(FORFEITED)
    with closing(env), operator(expert, env, port=port) if by_hand else nullcontext(asked) as demonstrator:
        handed = {"env": env, "expert": demonstrator, "collect": collect}
        yield {name: handed[name] for name in needs}


def _expert(spec: EnvSpec, source: str | None, typed: str | None) -> Policy:
    from aerial_il import experts
    from aerial_il.core.errors import InvalidValueError
    from aerial_il.experts.outside import load_expert
    from aerial_il.workflows.parts import typed_code
    from aerial_il.workflows.parts.environments import key_of

    if source is not None and typed_code.names_code(source):
        return typed_code.policy_of(source)
    if source is not None:
        return load_expert(source, key_of(spec, typed), noise=0.0)
    if spec.is_outside:
        raise InvalidValueError(
            f"There is no expert for {spec.robot}/{spec.task}: set expert=FILE or expert=module:factory."
        )
    return experts.make(spec.robot, spec.task)
