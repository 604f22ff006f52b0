"""Where an algorithm that flies while it learns does so, and whom it asks.

That is the environment of its demonstrations; an algorithm that needs none flies where it is told.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aerial_il.cli.flights.environments import Place
    from aerial_il.core.policy import Policy
    from aerial_il.core.specs import EnvSpec

WORLDS = 64


@contextmanager
def workplace(
    algorithm: Any,
    dataset: str | None,
    *,
    place: Place | None = None,
    images: tuple[str, ...],
    expert: str | None,
    tier: str | None,
    num_envs: int | None,
    threads: int,
) -> Iterator[dict[str, Any]]:
    """Yield what ``algorithm.train`` is to be handed besides data, by name; nothing where it only learns.

    Args:
        algorithm: its attribute ``needs`` names what it wants: ``env``, ``expert``, ``collect``.
        dataset: folder of the demonstrations, which say what environment they come from.
        place: where to fly without any; beside them, what the user typed of theirs.
        images: camera fields that the policy sees.
        expert: file of an expert from outside; None for the task's own.
        tier: how rough the air is; None as in the demonstrations.
        num_envs: worlds flown at once; None as the algorithm likes best (its ``worlds``).
        threads: of the simulation, or processes of worlds from outside; 0 for all cores.

    Raises:
        UnknownNameError: the task has no expert.
        InvalidValueError: an environment from outside without one, or nothing says where to fly.
    """
    needs = getattr(algorithm, "needs", ())
    if not needs:
        yield {}
        return
    import aerial_il
    from aerial_il.cli.flights.environments import Place
    from aerial_il.collection.collect import collect

    worlds, asked = num_envs or getattr(algorithm, "worlds", WORLDS), None
    if dataset is None:
        env = (place or Place()).load(tier, num_envs=worlds, threads=threads)
    else:
        spec = aerial_il.open_dataset(dataset).spec
        typed = place.env if place else None
        asked = _expert(spec, expert, typed) if "expert" in needs else None
        env = _environment(spec, images, tier, worlds, threads, typed)
    try:
        handed = {"env": env, "expert": asked, "collect": collect}
        yield {name: handed[name] for name in needs}
    finally:
        env.close()


def _environment(
    spec: EnvSpec, images: tuple[str, ...], tier: str | None, num_envs: int, threads: int, typed: str | None
) -> Any:
    import aerial_il
    from aerial_il.suite import outside
    from aerial_il.suite.outside.processes import processes_for
    from aerial_il.suite.scenario import horizon_of

    if spec.is_outside:
        processes = processes_for(threads, num_envs)
        options = outside.checked_options(spec)
        return outside.load(_key(spec, typed), num_envs=num_envs, processes=processes, **options)
    sizes = {spec.observation[name].shape[:2] for name in images}
    seen = {"cameras": tuple(name.removesuffix("_rgb") for name in images), "image_size": sizes.pop()} if images else {}
    return aerial_il.load_batch(
        spec.robot,
        spec.task,
        num_envs=num_envs,
        tier=tier or spec.tier,
        action=spec.action.level,
        num_threads=threads,
        controller=spec.controller,
        horizon=horizon_of(spec),
        **seen,
    )


def _expert(spec: EnvSpec, file: str | None, typed: str | None) -> Policy:
    import aerial_il
    from aerial_il.core.errors import InvalidValueError
    from aerial_il.experts.outside import load_expert

    if file is not None:
        return load_expert(file, _key(spec, typed), noise=0.0)
    if spec.is_outside:
        raise InvalidValueError(f"Nobody here can be asked about {spec.robot}/{spec.task}: say expert=FILE.")
    return aerial_il.expert(spec.robot, spec.task)


def _key(spec: EnvSpec, typed: str | None) -> str:
    from aerial_il.core.errors import InvalidValueError
    from aerial_il.suite import outside

    key = outside.key_of(spec, typed=typed)
    if key is None:
        where = f"{spec.robot}/{spec.task}"
        raise InvalidValueError(f"{where} is no environment that can be loaded by name: train in Python, see docs.")
    return key
