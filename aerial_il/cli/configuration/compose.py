"""Hand a command to Hydra: compose its configuration, make it a typed object, run it, or list the points of a sweep."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from aerial_il.cli import commands
from aerial_il.cli.commands import Command
from aerial_il.cli.configuration import groups, keys
from aerial_il.cli.configuration.overrides import prepare
from aerial_il.cli.configuration.quoting import literal
from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.core.fitting import check_types

QUIET = {"hydra": "quiet"}


def run_once(command: Command, overrides: list[str]) -> None:
    """Let Hydra compose the configuration and run ``command`` with it.

    Raises:
        AerialError: for every mistake in ``overrides``; whatever the command itself raises.
    """

    def job(cfg: Any) -> None:
        with explained(command):
            config = typed(command, cfg)
        command.run(config)

    _hydra(command, overrides, job)


def planned(command: Command, overrides: list[str]) -> list[tuple[tuple[str, ...], str]]:
    """Return, for each point of a sweep, the words that Hydra reads and the folder of its own, without running any.

    None where ``overrides`` only ask for the configuration to be printed.
    """
    points, target = list[tuple[tuple[str, ...], str]](), keys.output_key(command.config)

    def note(cfg: Any) -> None:
        from hydra.core.hydra_config import HydraConfig

        folder = os.path.relpath(HydraConfig.get().runtime.output_dir)
        own = (f"{target}={literal(folder)}",) if target else ()
        said = [word for word in HydraConfig.get().overrides.task if not (target and word.startswith(f"{target}="))]
        points.append(((*said, *own), folder))

    _hydra(command, overrides, note)
    return points


def swept(command: Command, words: list[str]) -> tuple[dict[str, Any], list[str]]:
    """Return key -> Hydra's sweep over its values, and the other words as Hydra reads them, the output's left out.

    Raises:
        InvalidValueError: nothing is swept, or a word cannot be read.
    """
    from hydra.core.override_parser.overrides_parser import OverridesParser

    said = [word for word in prepare(command, words) if not word.startswith(("-", "hydra."))]
    with explained(command):
        read = OverridesParser.create().parse_overrides(said)
    space = {each.key_or_group: each.value() for each in read if each.is_sweep_override()}
    if not space:
        raise InvalidValueError(
            "There is nothing to search: give a key an interval, e.g. 'algorithm.lr=interval(0.0001,0.01)'."
        )
    target = keys.output_key(command.config)
    fixed = [word for word, each in zip(said, read, strict=True) if not each.is_sweep_override()]
    return space, [word for word in fixed if not word.startswith(f"{target}=")]


def perform(name: str, overrides: Sequence[str]) -> None:
    """Run the command ``name`` with words that are as Hydra reads them, such as :func:`planned` returns."""
    command = commands.find(name)
    command.run(_composed(command, list(overrides)))


def compose(command: Command, words: list[str]) -> Any:
    """Return the typed configuration that ``words`` lead to, without running anything."""
    return _composed(command, prepare(command, words))


def _composed(command: Command, overrides: list[str]) -> Any:
    register(command)
    from hydra import compose as hydra_compose
    from hydra import initialize_config_module
    from hydra.core.global_hydra import GlobalHydra

    GlobalHydra.instance().clear()
    # `initialize` would search all frames and modules for its caller; any package does: no configuration is in a file
    with explained(command), initialize_config_module(commands.__name__, version_base="1.3"):
        return typed(command, hydra_compose(command.name, overrides))


def _hydra(command: Command, overrides: list[str], job: Callable[[Any], None]) -> None:
    """Hand ``job`` to Hydra's own entry."""
    register(command)
    import hydra

    failures: list[Exception] = []

    def kept(cfg: Any) -> None:
        try:  # Hydra would print its own words about an error
            job(cfg)
        except Exception as error:
            failures.append(error)

    os.environ["HYDRA_FULL_ERROR"] = "1"  # hand exceptions on instead of printing and exiting
    sys.argv = [f"aerial-il {command.name}", *overrides]
    with explained(command):
        hydra.main(version_base="1.3", config_path=None, config_name=command.name)(kept)()
    if failures:
        raise failures[0]


def register(command: Command) -> None:
    """Put the command's dataclass, and all that may be chosen in its groups, into Hydra's store, and nothing else.

    What another command of this process left there is taken out.
    """
    from hydra.core.config_store import ConfigStore

    store, target = ConfigStore.instance(), keys.output_key(command.config)
    store.repo = {name: node for name, node in store.repo.items() if name == "hydra" or name.startswith("_")}
    chosen = [{group: choice} for group, choice in command.choices.items()]
    store.store(name=f"{command.name}_keys", node=command.config)
    sweep = {"hydra": {"sweep": {"dir": f"${{{target}}}"}}} if target else {}
    store.store(name=command.name, node={"defaults": [f"{command.name}_keys", *chosen, QUIET, "_self_"], **sweep})
    store.store(group="hydra", name=QUIET["hydra"], node=groups.read_yaml(groups.conf_dir() / "hydra" / "quiet.yaml"))
    store.repo |= {group: _Choices(group) for group in command.choices}


class _Choices(dict[str, Any]):
    """The choices of a group as Hydra's store holds them: file name -> node, which is made when it is asked for.

    Hydra copies its whole store whenever it composes. Of some hundred choices a command needs ten, and these are copied
    once more when they are loaded.
    """

    def __init__(self, group: str) -> None:
        super().__init__({f"{name}.yaml": None for name in groups.options(group)})
        self._group = group

    def __getitem__(self, file: str) -> Any:
        from hydra.core.config_store import ConfigNode
        from omegaconf import OmegaConf

        name = file.removesuffix(".yaml")
        node = OmegaConf.structured(groups.read_option(self._group, name))
        package = "_global_" if groups.is_global(self._group, name) else None
        return ConfigNode(name=file, node=node, group=self._group, package=package, provider=None)

    def __deepcopy__(self, memo: dict[int, Any]) -> _Choices:
        return self


def typed(command: Command, cfg: Any) -> Any:
    """Turn a composed configuration into an instance of the command's dataclass."""
    from omegaconf import OmegaConf

    missing = sorted(OmegaConf.missing_keys(cfg))
    if missing:
        wanted = " ".join(f"{name.removesuffix('.path').removesuffix('.name')}=..." for name in missing)
        raise InvalidValueError(f"{command.name} needs {wanted} See: aerial-il {command.name} --help")
    config: Any = OmegaConf.to_object(cfg)
    check_types(type(config), vars(config), whose=command.name)
    return config


@contextmanager
def explained(command: Command) -> Iterator[None]:
    """Turn what Hydra and OmegaConf raise into an error of ours."""
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    try:
        yield
    except (HydraException, OmegaConfBaseException) as error:
        raise explain(command, error) from error


def explain(command: Command, error: Exception) -> AerialError:
    """Put a Hydra or OmegaConf error into one paragraph."""
    causes: list[str] = []
    cause: BaseException | None = error
    while cause is not None:
        first = str(cause).strip().splitlines()[:1]
        causes += [line for line in first if line not in causes]
        cause = cause.__cause__
    key = getattr(error.__cause__, "full_key", None) or getattr(error, "full_key", None)
    where = f"{key}: " if key else ""
    return InvalidValueError(f"{where}{' '.join(causes)} See: aerial-il {command.name} --help")
