"""Environments from outside, Gymnasium's and dm_env's, behind the interface of the suite's batch environment.

A key names one: ``gymnasium:AdroitHandDoor-v1`` or ``dm_control:cartpole-swingup``. Recordings and policies carry key
and options in their specification (``robot`` is what stands before the colon, ``task`` what follows), so that a policy
finds the environment it was trained in.
"""

from __future__ import annotations

import json
from functools import partial
from typing import TYPE_CHECKING, Any

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.specs import EnvSpec
from aerial_il.suite.outside.batch import OutsideBatch
from aerial_il.suite.outside.from_files import checked_key
from aerial_il.suite.outside.from_files import checked_options as checked_options
from aerial_il.suite.outside.processes import MakeBatch, SharedBatch

if TYPE_CHECKING:
    from aerial_il.suite.outside.dm_env_world import MakeEnv

GYMNASIUM, DM_CONTROL, DM_ENV = "gymnasium", "dm_control", "dm_env"
SOURCES = (GYMNASIUM, DM_CONTROL)


def load_gymnasium(
    name: str,
    *,
    num_envs: int = 1,
    processes: int = 1,
    success: str | None = None,
    max_steps: int | None = None,
    ends_at_success: bool = False,
    **settings: Any,
) -> OutsideBatch | SharedBatch:
    """Return ``num_envs`` worlds of a Gymnasium environment; see :func:`aerial_il.load_gymnasium`."""
    judged = {"success": success, "max_steps": max_steps, "ends_at_success": ends_at_success}
    return _shared(partial(_gymnasium_batch, name, settings, judged), num_envs, processes)


def load_dm_env(
    make: MakeEnv,
    *,
    num_envs: int = 1,
    processes: int = 1,
    name: str = "environment",
    source: str = DM_ENV,
    success: str | None = None,
    max_steps: int | None = None,
    ends_at_success: bool = False,
) -> OutsideBatch | SharedBatch:
    """Return ``num_envs`` worlds of a dm_env environment; see :func:`aerial_il.load_dm_env`."""
    judged = {"success": success, "max_steps": max_steps, "ends_at_success": ends_at_success}
    return _shared(partial(_dm_env_batch, make, source, name, judged), num_envs, processes)


def load_dm_control(name: str, *, num_envs: int = 1, processes: int = 1, **options: Any) -> OutsideBatch | SharedBatch:
    """Return worlds of dm_control's suite, named ``domain-task``; options as for :func:`load_dm_env`."""
    from dm_control import suite

    domain, _, task = name.rpartition("-")
    known = [f"{d}-{t}" for d, t in suite.ALL_TASKS]
    if name not in known:
        raise UnknownNameError("dm_control task", name, known)
    make = partial(_dm_control_env, domain, task)
    return load_dm_env(make, num_envs=num_envs, processes=processes, name=name, source=DM_CONTROL, **options)


def load(key: str, *, num_envs: int = 1, processes: int = 1, **options: Any) -> OutsideBatch | SharedBatch:
    """Return worlds of the environment that ``key`` names, e.g. ``gymnasium:Pendulum-v1``.

    Raises:
        InvalidValueError: no key. UnknownNameError: a source that there is not.
    """
    source, colon, name = key.partition(":")
    if not colon or not name:
        raise InvalidValueError(f"env={key} names no environment; write e.g. env=gymnasium:Pendulum-v1.")
    if source not in SOURCES:
        raise UnknownNameError("source of environments", source, SOURCES)
    loader = load_gymnasium if source == GYMNASIUM else load_dm_control
    return loader(name, num_envs=num_envs, processes=processes, **options)


def key_of(spec: EnvSpec, *, typed: str | None = None) -> str | None:
    """Return the key of a specification's environment, or None for one of the suite's, or one made by a caller.

    Args:
        spec: may come out of a file. typed: the key that the user typed, which alone may name a module.

    Raises:
        InvalidValueError: it names a module to import, and nobody typed it.
    """
    return checked_key(spec, typed) if spec.robot in SOURCES else None


def _shared(make: MakeBatch, num_envs: int, processes: int) -> OutsideBatch | SharedBatch:
    return make(num_envs) if processes == 1 else SharedBatch(make, num_envs, processes)


def _gymnasium_batch(name: str, settings: dict[str, Any], judged: dict[str, Any], num_envs: int) -> OutsideBatch:
    from aerial_il.suite.outside.gymnasium_world import GymnasiumWorld

    options = {"max_steps": judged["max_steps"], **_storable(settings)}
    make = partial(GymnasiumWorld, name, settings)
    return OutsideBatch(make, num_envs, source=GYMNASIUM, name=name, options=options, **judged)


def _dm_env_batch(make: MakeEnv, source: str, name: str, judged: dict[str, Any], num_envs: int) -> OutsideBatch:
    from aerial_il.suite.outside.dm_env_world import DmEnvWorld

    options = {"max_steps": judged["max_steps"]}
    return OutsideBatch(partial(DmEnvWorld, make), num_envs, source=source, name=name, options=options, **judged)


def _dm_control_env(domain: str, task: str, seed: int) -> Any:
    from dm_control import suite

    return suite.load(domain, task, task_kwargs={"random": seed})


def _storable(settings: dict[str, Any]) -> dict[str, Any]:
    """Return the settings that JSON can hold; others are named by their text, for the record."""

    def plain(value: Any) -> Any:
        try:
            return json.loads(json.dumps(value))
        except TypeError:
            return repr(value)

    return {name: plain(value) for name, value in settings.items()}
