"""Sessions on a real environment and a real disk: recorded, reviewed, kept, discarded, brought back, flown again."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import sleep

import numpy as np
import pytest

from aerial_il.core.errors import DemoError, InvalidValueError, StorageError
from aerial_il.data.episode import Episode
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.recording.writer import write_episode
from aerial_il.data.recovery import recover_episode
from aerial_il.data.replay import replay
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.physics.episode_state import FORCES
from aerial_il.teleop.devices.driver import BINDINGS, Driver
from aerial_il.teleop.devices.scripted import Scripted
from aerial_il.teleop.input.frame import LABELS, bits_of
from aerial_il.teleop.input.mapping import together
from aerial_il.teleop.session.cockpit import Cockpit
from aerial_il.teleop.session.logbook import Logbook
from aerial_il.teleop.session.refly import refly
from aerial_il.teleop.session.session import Event, State
from tests.teleop.hands import schedule, shipped, world

FLOWN_BY = together([BINDINGS, shipped("scripted")])  # the model of a driver, and scripts


def cockpit_of(env: BatchEnvironment, out: Path, **settings) -> Cockpit:
    logbook = Logbook(env, str(out), operator="ada", first_seed=5000)
    return Cockpit(env, FLOWN_BY, logbook, countdown=3, **settings)


def fly(cockpit: Cockpit, script: Callable[[int], list[str]], ticks: int) -> None:
    device = Scripted(script, cockpit.bindings)
    for _ in range(ticks):
        cockpit.tick(device.frame())


def recorded(cockpit: Cockpit, ticks: int = 60, ending: str = "save") -> None:
    """Record so many ticks of flight, and decide."""
    moving = (6, 6 + ticks // 2, ["forward+", "up-"])
    end = 5 + ticks
    parts = [(1, 2, ["record"]), moving, (end, end + 1, ["record"]), (end + 2, end + 3, [ending])]
    fly(cockpit, schedule(*parts), end + 5)


@pytest.fixture(scope="module")
def env() -> BatchEnvironment:
    return world(tier="gusts")


@pytest.fixture(scope="module")
def file(env: BatchEnvironment, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of one flight."""
    out = tmp_path_factory.mktemp("flown")
    cockpit = cockpit_of(env, out)
    recorded(cockpit, ticks=160)
    assert cockpit.state is State.IDLE
    cockpit.close()
    (file,) = DatasetFolder(out).files("failures")
    return file


@pytest.fixture(scope="module")
def episode(file: Path) -> Episode:
    return read_episode(file)


def test_a_flight_replays_by_its_actions_and_by_its_log(env: BatchEnvironment, episode: Episode) -> None:
    assert not episode.success
    assert len(episode) >= 158
    assert np.ptp(episode.actions[:, 2]) > 0.05, "it was flown"
    assert replay(env, episode) == refly(env, episode) == len(episode)
    assert episode.provenance["policy"] == "human:ada"
    assert episode.provenance["settings"]["time_scale"] == 1.0


def test_a_log_with_one_bit_changed_is_not_that_flight(env: BatchEnvironment, episode: Episode) -> None:
    rows = episode.extras["device"].copy()
    rows[10, LABELS.index("held_low")] = bits_of(["lateral+"], FLOWN_BY.controls)
    with pytest.raises(DemoError, match="step 10"):
        refly(env, replace(episode, extras={"device": rows}))


def test_a_log_of_another_version_of_the_pilot_is_refused(env: BatchEnvironment, episode: Episode) -> None:
    settings = {key: value for key, value in episode.provenance["settings"].items() if key != "pilot"}
    with pytest.raises(DemoError, match="another version of the pilot"):
        refly(env, replace(episode, provenance={**episode.provenance, "settings": settings}))


def test_recordings_with_or_without_frames_are_read(file: Path, episode: Episode, tmp_path: Path) -> None:
    copy = read_episode(write_episode(episode, tmp_path / "copy.mcap"))
    np.testing.assert_array_equal(copy.extras["device"], episode.extras["device"])
    plain = replace(episode, extras={}, extra_labels={})
    assert not read_episode(write_episode(plain, tmp_path / "plain.mcap")).extras
    cut = tmp_path / "cut.mcap"
    raw = file.read_bytes()
    cut.write_bytes(raw[: len(raw) * 7 // 10])  # what eyes see stands at the end: less than that loses no step
    saved = read_episode(recover_episode(cut, tmp_path / "saved.mcap").path)
    assert 10 < len(saved) < len(episode)
    np.testing.assert_array_equal(saved.extras["device"], episode.extras["device"][: len(saved)])


def test_a_byte_changed_in_the_frames_is_noticed(file: Path, tmp_path: Path) -> None:
    raw = bytearray(file.read_bytes())
    raw[len(raw) // 2] ^= 1
    (tmp_path / file.name).write_bytes(raw)
    with pytest.raises(DemoError):
        read_episode(tmp_path / file.name)


def test_discarded_goes_to_the_trash_and_undo_brings_it_back(tmp_path: Path) -> None:
    cockpit = cockpit_of(world(), tmp_path)
    recorded(cockpit, ending="discard")
    recorded(cockpit, ending="discard")
    cockpit.logbook.settle(wait=True)
    assert cockpit.logbook.counts() == {"demos": 0, "failures": 0, "trash": 2}
    assert cockpit.logbook.seed == 5000, "the seed of a discarded take is flown again"
    recorded(cockpit)
    fly(cockpit, schedule((1, 2, ["undo"]), (4, 5, ["undo"]), (7, 8, ["undo"])), 9)
    assert cockpit.message == "There is nothing to bring back."
    cockpit.close()
    assert cockpit.logbook.counts() == {"demos": 0, "failures": 3, "trash": 0}
    files = DatasetFolder(tmp_path).files("failures")
    assert len({file.name for file in files}) == 3, "takes of one seed have names of their own"
    assert [read_episode(file).seed for file in files] == [5000] * 3
    assert set(DatasetFolder(tmp_path).read_index()["failures"]) == {file.stem for file in files}


def test_a_trash_that_somebody_emptied_ends_no_session(tmp_path: Path) -> None:
    cockpit = cockpit_of(world(), tmp_path)
    recorded(cockpit, ending="discard")
    cockpit.logbook.settle(wait=True)
    shutil.rmtree(tmp_path / "trash")
    fly(cockpit, schedule((1, 2, ["undo"])), 3)
    assert "It cannot be brought back" in cockpit.message
    recorded(cockpit)
    cockpit.close()
    assert cockpit.logbook.counts()["failures"] == 1


def test_a_session_goes_on_where_it_stopped(tmp_path: Path) -> None:
    env = world()
    for _ in range(2):
        cockpit = cockpit_of(env, tmp_path)
        recorded(cockpit)
        cockpit.close()
    assert sorted(read_episode(file).seed for file in DatasetFolder(tmp_path).files("failures")) == [5000, 5001]


@pytest.mark.parametrize(
    ("other", "key"),
    [
        ({"task": "pick_place"}, "task"),
        ({"action": "velocity"}, "action"),
        ({"tier": "gusts"}, "tier: 'calm' != 'gusts'"),
    ],
)
def test_another_environments_folder_names_what_differs(tmp_path: Path, other: dict, key: str) -> None:
    cockpit = cockpit_of(world(), tmp_path)
    cockpit.close()
    with pytest.raises(InvalidValueError, match=key):
        cockpit_of(world(**other), tmp_path)


def test_time_stands_still_in_pauses_and_they_leave_no_steps(tmp_path: Path) -> None:
    env = world()
    cockpit = cockpit_of(env, tmp_path)
    script = schedule(
        (1, 2, ["record"]),
        (8, 40, ["forward+"]),
        (30, 31, ["pause"]),
        (60, 61, ["pause"]),
        (80, 81, ["save"]),
        (83, 84, ["save"]),
    )
    fly(cockpit, script, 90)
    cockpit.close()
    episode = read_episode(DatasetFolder(tmp_path).files("failures")[0])
    assert len(episode) < 60
    assert refly(env, episode) == len(episode)


def test_nobody_at_the_controls_pauses_a_recording(tmp_path: Path) -> None:
    cockpit = cockpit_of(world(), tmp_path)
    fly(cockpit, schedule((1, 2, ["record"])), 20)
    assert cockpit.state is State.RECORDING
    cockpit.happen(Event.LOST)
    assert cockpit.state is State.PAUSED
    cockpit.close()


def test_only_a_solved_episode_is_a_demonstration(tmp_path: Path) -> None:
    env = world()
    cockpit = cockpit_of(env, tmp_path)
    solve_reach(cockpit)
    assert cockpit.state is State.REVIEW
    assert cockpit.status().success
    fly(cockpit, schedule((1, 2, ["save"])), 4)
    cockpit.close()
    (file,) = DatasetFolder(tmp_path).files()
    episode = read_episode(file)
    assert episode.success
    assert refly(env, episode) == len(episode)


def test_a_success_may_be_called_a_failure_but_not_reversed(tmp_path: Path) -> None:
    cockpit = cockpit_of(world(), tmp_path)
    solve_reach(cockpit)
    fly(cockpit, schedule((1, 2, ["label"]), (3, 4, ["save"])), 6)
    recorded_label = schedule(
        (1, 2, ["record"]), (40, 41, ["save"]), (42, 43, ["label"]), (44, 45, ["label"]), (46, 47, ["save"])
    )
    fly(cockpit, recorded_label, 50)
    cockpit.close()
    assert cockpit.logbook.counts()["demos"] == 0
    first, second = (read_episode(file) for file in DatasetFolder(tmp_path).files("failures"))
    assert first.provenance["note"] == "the operator called it a failure"
    assert not second.success


def test_a_full_disk_is_told_and_the_flight_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    env = world()
    cockpit = cockpit_of(env, tmp_path)
    recorded(cockpit)
    cockpit.logbook.settle(wait=True)

    def full(*_: object, **__: object) -> None:
        raise StorageError(tmp_path, OSError(28, "No space left on device"))

    with monkeypatch.context() as patch:
        patch.setattr("aerial_il.data.recording.writer.EpisodeWriter.append", full)
        device = Scripted(schedule((1, 2, ["record"])), cockpit.bindings)
        for _ in range(400):  # another thread writes: it may take some ticks until its failure is met
            cockpit.tick(device.frame())
            if "No space left" in cockpit.message:
                break
            sleep(0.002)
    assert "No space left" in cockpit.message
    assert "No space left" in caplog.text
    assert "aerial-il recover" in caplog.text
    assert cockpit.state is State.IDLE
    recorded(cockpit)
    cockpit.close()
    assert cockpit.logbook.counts()["failures"] == 2


def test_what_a_killed_flight_left_is_named_at_the_next(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (part := tmp_path / "demos" / "killed.mcap.part").parent.mkdir()
    part.touch()
    cockpit_of(world(), tmp_path).close()
    assert "1 recordings that a killed flight left" in caplog.text
    assert f"aerial-il recover path={tmp_path}" in caplog.text


def test_how_long_success_has_held_is_shown_until_it_is_believed(tmp_path: Path) -> None:
    cockpit = cockpit_of(world(), tmp_path)
    shown = solve_reach(cockpit)
    cockpit.close()
    assert shown[0] == 0.0
    assert shown[-1] == 1.0
    held = shown[len(shown) - 1 - shown[::-1].index(0.0) :]
    assert held == sorted(held), "it only grows while it holds"
    assert len(held) == pytest.approx(50 + 25, abs=2), "1 s that the task asks for, and half a second to believe it"


def test_what_is_lost_for_good_is_said_once(tmp_path: Path) -> None:
    cockpit = cockpit_of(world(task="press_button"), tmp_path)
    fly(cockpit, schedule((1, 2, ["record"])), 8)
    assert cockpit.status().lost == ()
    cockpit.env.simulation.view.userdata[0, FORCES] = 100.0  # N, as after a blow
    fly(cockpit, schedule(), 1)
    assert cockpit.status().lost == ("gentle",)
    assert "“gentle” is lost" in cockpit.message
    cockpit.message = ""
    fly(cockpit, schedule(), 1)
    assert cockpit.message == ""
    cockpit.happen(Event.DISCARD)
    assert cockpit.status().lost == (), "the next flight is another one"
    cockpit.close()


def solve_reach(cockpit: Cockpit) -> list[float]:
    """Let the model of a driver fly until the session asks what to do with it; return the share held at each tick."""
    driver, held = Driver("reach", cockpit.readings, dt=cockpit.env.spec.control_dt_s, seed=1), list[float]()
    while cockpit.state is not State.REVIEW:
        driver.see(cockpit.status())
        cockpit.tick(driver.frame())
        held.append(cockpit.status().held)
    return held
