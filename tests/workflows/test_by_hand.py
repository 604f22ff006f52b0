"""What ``aerial-il train`` does by itself about flights by hand, what it says of it, and how it is switched off."""

from pathlib import Path

import pytest
import yaml

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.dagger import DAgger
from aerial_il.algorithms.interactive.gates.human import HumanGate
from aerial_il.cli.main import main
from aerial_il.data.waypoints import LOOKAHEAD_S, Waypoints
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.egocentric import egocentric
from aerial_il.teleop.driver.operator import DriverOperator
from aerial_il.workflows.parts.by_hand import suited
from tests.teleop.hands import world

SMALL = ["policy.hidden=[8]", "algorithm.steps=2", "progress=false"]
SUITED = Waypoints(lookahead_s=LOOKAHEAD_S, flown_by="hand")


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Flights by the model of a person: by poses, ``hands``; by differences, ``rates``; and by a ``script``."""
    folder = tmp_path_factory.mktemp("by_hand")
    for name, settings in (("hands", {}), ("rates", {"action": "ee_delta"})):
        env = world(**settings)
        DriverOperator().record(env, None, folder / name, seeds=range(5000, 5001 if settings else 5002), tags={})
        env.close()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["collect", "robot=fa_hexa_arm4", "task=reach", "episodes=1", "out=script", "progress=false"]) == 0
    return folder


def test_a_run_says_what_it_does_about_flights_by_hand(
    home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(home)
    assert main(["train", "dataset=hands", *SMALL, "run=suited"]) == 0
    told = capsys.readouterr().err
    assert "Flown by hand (human:driver)" in told
    assert "dataset.by_hand=false" in told
    result = yaml.safe_load((home / "suited" / "config.yaml").read_text())
    assert result["settings"]["waypoints"] == {"lookahead_s": LOOKAHEAD_S, "flown_by": "hand"}
    assert result["policy"]["relative"] is True
    assert main(["train", "dataset=hands", "dataset.by_hand=false", *SMALL, "run=recorded"]) == 0
    assert "by hand" not in capsys.readouterr().err
    result = yaml.safe_load((home / "recorded" / "config.yaml").read_text())
    assert result["settings"]["waypoints"]["lookahead_s"] == 0
    assert result["policy"]["relative"] is False
    assert "dataset.by_hand=false" in (home / "recorded" / "command.json").read_text()


def test_only_flights_by_hand_that_command_poses_are_taken_so(home: Path) -> None:
    as_it_is = (BC(), MLP())
    for folder in ("script", "rates"):
        assert suited(str(home / folder), *as_it_is, by_hand=None) == as_it_is
    assert suited(None, *as_it_is, by_hand=True) == as_it_is
    algorithm, policy = suited(str(home / "script"), *as_it_is, by_hand=True)
    assert algorithm.waypoints == Waypoints(lookahead_s=LOOKAHEAD_S, flown_by="anyone")
    assert policy == egocentric(MLP())


def test_what_the_user_has_chosen_is_kept(home: Path) -> None:
    cloning = BC(waypoints=Waypoints(lookahead_s=0.5, flown_by="hand"))
    for mine in (MLP(masked_fields=("gripper",)), MLP(obs_names=("ee_pos",)), MLP(relative=True)):
        assert suited(str(home / "hands"), cloning, mine, by_hand=None) == (cloning, mine)


def test_rounds_of_taking_over_learn_so_too(home: Path) -> None:
    algorithm, policy = suited(str(home / "hands"), DAgger(gate=HumanGate()), MLP(), by_hand=None)
    assert isinstance(algorithm.training, BC)
    assert algorithm.training.waypoints == SUITED
    assert policy.relative
