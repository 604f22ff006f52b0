"""What counts as intact after a power cut: not a finished episode with a byte changed, nor an open one that is gone."""

from pathlib import Path

from aerial_il.data.folder import DatasetFolder
from experiments.teleop.study import found_rows, targets_of
from tests.teleop.hands import world
from tests.teleop.session.test_cockpit import cockpit_of, fly, recorded, schedule


def test_what_was_told_must_be_there_and_whole(tmp_path: Path) -> None:
    env = world()
    cockpit = cockpit_of(env, tmp_path)
    recorded(cockpit, ticks=30)
    cockpit.logbook.settle(wait=True)
    fly(cockpit, schedule((1, 2, ["record"]), (6, 100, ["up-"])), 100)
    cockpit.logbook.close()
    told = {"finished": 1, "steps": 90}
    assert found_rows(env, tmp_path, told)["intact"]
    assert not found_rows(env, tmp_path, {**told, "finished": 2})["intact"]
    assert not found_rows(env, tmp_path, {**told, "steps": 400})["intact"]
    (file,) = DatasetFolder(tmp_path).files("failures")
    raw = bytearray(file.read_bytes())
    raw[len(raw) // 2] ^= 1
    file.write_bytes(raw)
    result = found_rows(env, tmp_path, told)
    assert (result["whole"], result["intact"]) == (0, False)


def test_targets_are_missed_by_what_misses_them() -> None:
    page = {"on_time_percent": 94.9, "ticks": 9, "key_ms": 101.0, "keys": 1, "key_ms_95": 1.0, "steps": 3}
    cuts = [{"intact": True}, {"intact": False}]
    targets = targets_of({**page, "replayed_percent": 99.9}, {"age_ms": 501.0, "age_ms_95": 1.0}, [301.0], cuts)
    assert len(targets) == 6
    assert not any(target.met for target in targets)
