"""An environment from outside is imported because its key was typed, never because a folder names it."""

import json
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from aerial_il.cli import commands
from aerial_il.cli.main import main

KEY = "gymnasium:bait:Bait-v0"
BAIT = """
from pathlib import Path
import gymnasium

Path(__file__).with_name("imported").touch()
if "Bait-v0" not in gymnasium.registry:
    gymnasium.register("Bait-v0", "gymnasium.envs.classic_control.cartpole:CartPoleEnv", max_episode_steps=20)
"""
QUIET = "progress=false"
SMALL = ["policy.hidden=[8]", "policy.chunk=1", "policy.ensemble=null", "algorithm.steps=2"]
CLONE = [*SMALL, "algorithm.validate_every=0", "algorithm.cadence.log_every=1"]
OPENING = {  # every command that opens a folder or a file, and the ways in which it does
    "browse": [["demos", "out=seen.html"]],
    "card": [["demos", "out=card.html"], ["demos", "out=card.html", "readme=README.md"]],
    "collect": [["env=gymnasium:CartPole-v1", "policy=policy", "episodes=1", "out=flown"]],
    "compare": [["policy", "policy"]],
    "convert": [["demos"]],
    "delete": [["demos", "where=seed == 3"]],
    "evaluate": [["policy=policy", "out=out", "episodes=2"], ["policy=run", "out=out", "episodes=2", "threads=1"]],
    "export": [["policy", "out=exported"], ["run", "out=exported"]],
    "filter": [["demos", "where=seed < 2", "out=kept"]],
    "fly": [["policy=policy", "out=flown"], ["policy=run", "out=flown"]],
    "generate": [["dataset=demos", "out=made", "episodes=1"]],
    "info": [["demos"]],
    "inspect": [["demos", "save=seen.rrd"], ["run", "save=seen.rrd"], ["demos", "policy=policy", "save=seen.rrd"]],
    "judge": [["demos"]],
    "leaderboard": [["run", "out=board.html"]],
    "merge": [["demos", "demos", "out=merged"]],
    "prefer": [["demos", "length=2", "pairs=1", "out=said.jsonl"]],
    "publish": [["demos", "out=hub", "license=mit"]],
    "recover": [["demos"]],
    "relabel": [["demos", "where=seed == 0", "tag=first"]],
    "replay": [["demos"]],
    "report": [["run"], ["policy"]],
    "reward": [["run", "dataset=demos"]],
    "runs": [[".", "page=true", "compare=true"], ["run", "json=true"]],
    "segment": [["demos", "page=false"]],
    "split": [["demos", "parts=[a=0.5,b=0.5]", "out=split"]],
    "train": [
        ["from=run", "run=new"],
        ["from=asked", "run=new", "dataset=demos"],
        ["from=placed", "run=new", "dataset=demos"],
        ["dataset=demos", "run=new", *CLONE],
        ["dataset=demos", "run=rolled", *CLONE, "evaluate_every=1", "evaluate_episodes=2"],
        ["algorithm=gail", "policy=squashed_gaussian", "dataset=demos", "run=new"],
        ["algorithm=dagger", "dataset=demos", "run=new"],
        ["env=gymnasium:CartPole-v1", "algorithm=gail", "policy=squashed_gaussian", "dataset=demos", "run=new"],
    ],
    "teleop": [
        ["robot=quad", "task=hover", "out=demos", "open=false", "port=0"],
        ["robot=quad", "task=hover", "policy=policy", "out=flown", "open=false", "port=0"],
    ],
    "undo": [["demos"]],
    "validate": [["demos"], ["demos", "replay=true"]],
    "view": [["policy=policy", "out=seen.html"], ["policy=policy", "out=seen.rrd"], ["recording=demos"]],
}
CLOSED = (
    "bench",
    "demo",
    "docs",
    "doctor",
    "film",
    "list",
    "new",
    "simulate",
)  # open nothing of somebody else
FLYING = [("evaluate", 0), ("evaluate", 1), ("train", 4), ("train", 5), ("view", 0)]


class Trap(NamedTuple):
    """Folders that name a module, which notes when it is imported."""

    home: Path
    imported: Path


@pytest.fixture(scope="module")
def trap(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Trap]:
    home = tmp_path_factory.mktemp("trap")
    (home / "bait.py").write_text(BAIT)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(home)
        patch.syspath_prepend(home)
        flown = ["success=survived", "max_steps=5", "episodes=4", "threads=1", QUIET]
        assert main(["collect", f"env={KEY}", "policy=random", *flown, "out=demos"]) == 0
        assert (home / "imported").exists(), "what is typed may import"
        assert main(["train", "dataset=demos", "run=run", *CLONE, QUIET]) == 0
        for place, named in (("asked", {"expert": "bait:make"}), ("placed", {"env": KEY})):
            shutil.copytree(home / "run", home / place)
            (home / place / "command.json").write_text(json.dumps({"settings": named}))
        (home / "policy").symlink_to(home / "run" / "policy")
        yield Trap(home, home / "imported")
    sys.modules.pop("bait", None)


@pytest.fixture
def unsprung(trap: Trap, monkeypatch: pytest.MonkeyPatch) -> Trap:
    monkeypatch.chdir(trap.home)
    monkeypatch.syspath_prepend(trap.home)
    trap.imported.unlink(missing_ok=True)
    sys.modules.pop("bait", None)
    return trap


def test_every_command_is_tried() -> None:
    assert sorted([*OPENING, *CLOSED]) == sorted(commands.names())


@pytest.mark.parametrize(("name", "words"), [(name, ways) for name, each in OPENING.items() for ways in each])
def test_no_command_imports_what_a_folder_names(name: str, words: list[str], unsprung: Trap) -> None:
    quiet = [QUIET] if any(field == "progress" for field in commands.find(name).settings.__dataclass_fields__) else []
    main([name, *words, *quiet])
    assert not unsprung.imported.exists()
    assert "bait" not in sys.modules


@pytest.mark.parametrize(("name", "way"), FLYING)
def test_who_wants_to_fly_there_is_told_what_to_type(
    name: str, way: int, unsprung: Trap, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([name, *OPENING[name][way], QUIET]) == 2
    assert f"env={KEY}" in capsys.readouterr().err
    assert not unsprung.imported.exists()


@pytest.mark.parametrize(
    "words",
    [
        ["evaluate", "policy=run", "out=judged", "episodes=2", "videos=0", "threads=1"],
        ["train", "dataset=demos", "run=watched", *CLONE, "evaluate_every=1", "evaluate_episodes=2", "threads=1"],
    ],
)
def test_what_is_typed_is_flown(words: list[str], unsprung: Trap) -> None:
    assert main([*words, f"env={KEY}", QUIET]) == 0
    assert unsprung.imported.exists()
