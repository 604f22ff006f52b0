"""One flight becomes many, by the command: on other places, other robots, in gusts, and the same bytes again."""

import shutil
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aerial_il.cli.main import main
from aerial_il.data.dataset import open_dataset
from aerial_il.data.table import CACHE
from aerial_il.generation.diversion import STEPS
from aerial_il.generation.force import pressing_in
from aerial_il.workflows.info import Info, info

Shown = Callable[[str], Path]
pytestmark = pytest.mark.usefixtures("no_commit")


def generate(source: Path, out: Path, *words: str) -> int:
    few = ["episodes=8", "num_envs=8", "threads=1", "progress=false"]
    return main(["generate", f"dataset={source}", f"out={out}", *few, *words])


def files(folder: Path) -> dict[str, str]:
    return {file.name: sha256(file.read_bytes()).hexdigest() for file in folder.glob("*/*.mcap")}


@pytest.mark.parametrize(
    ("task", "words"),
    [
        ("pick_place", []),
        ("pick_place", ["robot=ua_quad_arm4", "tier=gusts"]),
        ("insert_peg", []),
        ("open_door", []),
        ("press_button", ["noise=0.3"]),
    ],
)
def test_one_flight_becomes_many(shown: Shown, tmp_path: Path, task: str, words: list[str]) -> None:
    assert generate(shown(task), tmp_path / "many", *words) == 0
    flights = list(open_dataset(tmp_path / "many", failures=True))
    assert sum(flight.success for flight in flights) >= 7
    made = flights[0].provenance
    (source,) = made["settings"]["sources"]
    assert source == next(iter(open_dataset(shown(task)))).uid
    phases = flights[0].phase
    assert phases[0] == 0
    assert 1 in phases


def test_each_flight_names_its_source_and_how_it_was_moved(shown: Shown, tmp_path: Path) -> None:
    assert generate(shown("pick_place"), tmp_path / "many", "episodes=3") == 0
    source = next(iter(open_dataset(shown("pick_place"))))
    for flight in open_dataset(tmp_path / "many"):
        made = flight.provenance["made_of"]
        at_cube, at_bowl = made["segments"]
        assert made["source"] == source.uid
        assert [at_cube["thing"], at_bowl["thing"]] == ["cube", "bowl"]
        turn = Rotation.from_rotvec(at_cube["turned_rad"])
        moved = turn.apply(source.obs["cube_pos"][0]) + at_cube["shifted_m"]
        np.testing.assert_allclose(moved, flight.obs["cube_pos"][0], atol=5e-3)
        assert at_bowl["turned_rad"] == [0.0, 0.0, 0.0]
        assert 0 <= at_cube["source_steps"][0] < at_cube["source_steps"][1] <= at_bowl["source_steps"][0]
        assert at_bowl["source_steps"][1] == len(source)


def test_labels_are_the_commands_without_noise(shown: Shown, tmp_path: Path) -> None:
    assert generate(shown("pick_place"), tmp_path / "noisy", "noise=0.5", "episodes=2") == 0
    for flight in open_dataset(tmp_path / "noisy", failures=True):
        apart = np.abs(flight.executed_actions - flight.expert_actions)
        assert apart[:, :3].max() > 0.005
        assert apart[:, 3:].max() < 1e-6


def test_flights_are_led_aside_and_shown_the_way_back(shown: Shown, tmp_path: Path) -> None:
    assert generate(shown("insert_peg"), tmp_path / "aside", "disturbed=0.3", "episodes=4") == 0
    flights = list(open_dataset(tmp_path / "aside"))
    assert len(flights) >= 3
    farthest = []
    for flight in flights:
        apart = np.linalg.norm(flight.executed_actions[:, :3] - flight.expert_actions[:, :3], axis=1)
        assert apart[:STEPS].max() > 0.05
        assert apart[STEPS:].max() < 1e-6
        tool = flight.obs["ee_pos"]
        farthest.append(np.linalg.norm(tool[STEPS] - tool[0]))
    assert max(farthest) > 0.1
    assert max(farthest) < 0.35


def test_a_flight_that_presses_too_hard_is_a_failure_and_says_so(
    shown: Shown, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for force, kept in (("2", 4), ("0.2", 0)):
        out = tmp_path / force
        assert generate(shown("open_door"), out, f"force={force}", "episodes=4") == 0
        flights = list(open_dataset(out, failures=True))
        assert sum(flight.success for flight in flights) == kept
        assert all("more than" in flight.provenance["note"] for flight in flights if not flight.success)
    said = capsys.readouterr()
    assert "raise force=0.2" in said.err
    assert said.out.count("run=runs/generated") == 1, "there is nothing to train on without a success"
    assert main(["info", str(out), "where='pressed with' in note"]) == 0
    assert generate(out, tmp_path / "none") == 2
    assert "none of 4 flights succeeded" in capsys.readouterr().err


def test_it_is_the_same_however_many_worlds_and_goes_on(
    shown: Shown, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, worlds in (("one", 1), ("three", 3)):
        assert generate(shown("press_button"), tmp_path / name, "episodes=3", f"num_envs={worlds}") == 0
    assert files(tmp_path / "one") == files(tmp_path / "three")
    before = files(tmp_path / "one")
    assert generate(shown("press_button"), tmp_path / "one", "episodes=4") == 0
    assert before.items() < files(tmp_path / "one").items()
    assert "Next: aerial-il train" in capsys.readouterr().out


def test_what_was_generated_is_known_to_info(shown: Shown, tmp_path: Path) -> None:
    out = tmp_path / "known"
    assert generate(shown("press_button"), out, "episodes=2") == 0
    told = (out / CACHE).read_text()
    known = info(Info(path=str(out)))["episodes"]
    assert (out / CACHE).read_text() == told, "nothing had to be added"
    assert len(known) == 2
    (out / CACHE).unlink()
    assert info(Info(path=str(out)))["episodes"] == known, "the recordings say the same"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["sources=2"], "has 1 successful demonstrations; sources=2 asks for more"),
        (["select=best"], "is not one of random, nearest"),
        (["noise=2"], "noise lies between 0 and 1"),
        (["disturbed=0.6"], "disturbed lies between 0 and 0.5 m, got 0.6"),
        (["disturbed=-0.1"], "disturbed=-0.1 is too small"),
        (["force=0"], "force is 0"),
        (["episodes=0"], "episodes=0 is too small"),
        (["robot=quad"], "quad cannot do pick_place"),
    ],
)
def test_bad_words_are_answered(
    shown: Shown, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    assert generate(shown("pick_place"), tmp_path / "many", *words) == 2
    assert said in capsys.readouterr().err


def test_the_sources_stay_as_they_are(shown: Shown, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = files(shown("pick_place"))
    assert generate(shown("pick_place"), shown("pick_place")) == 2
    assert "is where the episodes of" in capsys.readouterr().err
    assert files(shown("pick_place")) == before


def test_sources_of_two_robots_need_a_word_on_who_is_to_fly(
    shown: Shown, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = tmp_path / "both"
    shutil.copytree(shown("press_button"), both / "hexa")
    flown = ["collect", "robot=ua_quad_arm4", "task=press_button", "episodes=1", "expert.noise=0", "progress=false"]
    assert main([*flown, f"out={both / 'quad'}"]) == 0
    assert generate(both, tmp_path / "many") == 2
    assert "flown by fa_hexa_arm4, ua_quad_arm4: say who is to fly, e.g. robot=fa_hexa_arm4" in capsys.readouterr().err
    hexa, quad, all_of_them = (pressing_in(open_dataset(place)) for place in (both / "hexa", both / "quad", both))
    assert min(hexa, quad) <= all_of_them <= max(hexa, quad), "each in the scene of its own robot"
