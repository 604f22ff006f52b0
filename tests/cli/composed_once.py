"""Hydra with its pure steps remembered, so that thousands of command lines can be composed in minutes.

What is remembered: a command's entries in Hydra's store, the list of defaults for a choice of groups, the configuration
that these defaults make, and the types of a dataclass. Every word is still parsed, put into a configuration of its own
and checked; that nobody says ``hydra.mode`` is known without composing all once more.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, get_type_hints

import pytest
from hydra._internal import config_loader_impl
from hydra._internal.defaults_list import DefaultsList, Overrides
from hydra._internal.hydra import Hydra
from hydra.core.config_store import ConfigStore

from aerial_il.cli.configuration import compose, overrides


@contextmanager
def composed_once() -> Iterator[None]:
    """Within it, the same defaults are composed once; commands and groups must not change meanwhile."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compose, "register", _registered_once(compose.register))
        patch.setattr(ConfigStore, "__deepcopy__", lambda store, memo: store, raising=False)  # its nodes are copied
        listed = _listed_once(config_loader_impl.create_defaults_list)
        patch.setattr(config_loader_impl, "create_defaults_list", listed)
        loader = config_loader_impl.ConfigLoaderImpl
        made = _made_once(loader._compose_config_from_defaults_list)
        patch.setattr(loader, "_compose_config_from_defaults_list", made)
        patch.setattr(Hydra, "get_mode", _mode_if_said(Hydra.get_mode))
        patch.setattr(overrides, "get_type_hints", cache(get_type_hints))
        yield


def _mode_if_said(get_mode: Any) -> Any:
    def mode(hydra: Any, config_name: str | None, overrides: list[str]) -> Any:
        said = any("hydra" in word.partition("=")[0] for word in overrides)
        return get_mode(hydra, config_name, overrides) if said else None

    return mode


def _registered_once(register: Any) -> Any:
    entries: dict[str, Any] = {}

    def registered(command: Any) -> None:
        if command.name not in entries:
            register(command)
            entries[command.name] = ConfigStore.instance().repo
        ConfigStore.instance().repo = entries[command.name]

    return registered


def _listed_once(create: Any) -> Any:
    """Remember a list of defaults by the words that choose in groups; the others are kept apart from it."""
    lists: dict[tuple[object, ...], DefaultsList] = {}

    def listed(*, repo: Any, config_name: str, overrides_list: list[Any], **options: Any) -> DefaultsList:
        said = Overrides(repo=repo, overrides_list=overrides_list)
        others = {id(each) for each in said.config_overrides}
        choosing = [each for each in overrides_list if id(each) not in others]
        key = config_name, options["skip_missing"], *(each.input_line for each in choosing)
        if key not in lists:
            lists[key] = create(repo=repo, config_name=config_name, overrides_list=choosing, **options)
        known = lists[key]
        return DefaultsList(known.defaults, known.defaults_tree, said.config_overrides, known.overrides)

    return listed


def _made_once(compose_from: Any) -> Any:
    configs: dict[int, tuple[list[Any], bytes]] = {}  # the list is kept, so that its identity stays its own

    def made(loader: Any, defaults: list[Any], repo: Any) -> Any:
        if id(defaults) not in configs:
            configs[id(defaults)] = defaults, pickle.dumps(compose_from(loader, defaults=defaults, repo=repo))
        return pickle.loads(configs[id(defaults)][1])

    return made
