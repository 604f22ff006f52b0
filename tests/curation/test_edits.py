"""Edits where the episodes lie: what they change, that nothing else does, and the way back from every moment."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aerial_il.cli.main import main
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.curation.selection import select
from aerial_il.data.dataset import altered_files, open_dataset
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.recording.writer import write_episode
from aerial_il.data.table import read_table, write_column
from tests.cli.test_full_disk import LIMITED
from tests.curation.conftest import QUIET, Recorded, digests
from tests.curation.test_derive import killed_at

STEPS = ("actions", "executed_actions", "expert_actions", "rewards", "states", "ctrl", "sim_time", "phase", "truncated")


def edit(*words: object) -> int:
    return main([*map(str, words), QUIET])


def test_what_is_deleted_counts_nowhere_and_returns(dataset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = digests(dataset)
    assert edit("delete", dataset, "where=not success") == 0
    said = capsys.readouterr().out
    assert "Take it back: aerial-il undo" in said
    left = open_dataset(dataset, failures=True)
    assert 0 < len(left) < 12
    assert all(episode.success for episode in left)
    assert not list(dataset.glob("failures/*"))
    assert edit("info", dataset) == 2, "info shows no progress bar"
    assert main(["info", str(dataset), "json=true"]) == 0
    assert len(json.loads(capsys.readouterr().out)["episodes"]) == len(left)
    assert edit("convert", dataset, f"out={dataset.parent / 'a.hdf5'}") == 0
    assert len(open_dataset(dataset.parent / "a.hdf5")) == len(left)
    assert edit("validate", dataset) == 0
    assert edit("undo", dataset) == 0
    assert digests(dataset) == before
    assert not (dataset / "trash").exists()
    assert edit("undo", dataset) == 2
    assert "has no edit to take back" in capsys.readouterr().err


def test_labels_change_and_the_flight_does_not(dataset: Path) -> None:
    before = digests(dataset)
    victim = open_dataset(dataset)[0]
    words = ["success=false", "operator=anna", "instruction=Catch the ball.", "tag=odd"]
    assert edit("relabel", dataset, f"where=uid == '{victim.uid}'", *words) == 0
    relabelled = read_episode(dataset / "failures" / f"{victim.uid}.mcap")
    assert not (dataset / "demos" / f"{victim.uid}.mcap").exists()
    for name in STEPS:
        np.testing.assert_array_equal(getattr(relabelled, name), getattr(victim, name))
    assert (relabelled.success, relabelled.spec.instruction) == (False, "Catch the ball.")
    (changed,) = relabelled.provenance["relabelled"]
    assert changed["was"] == {
        "success": True, "operator": "ana", "instruction": "Bring the hook to the ball.", "tag": "",
    }  # fmt: skip
    row = next(row for row in read_table(open_dataset(dataset, failures=True)) if row["uid"] == victim.uid)
    assert (row["operator"], row["tag"], row["failure"]) == ("anna", "odd", "other")
    assert edit("validate", dataset) == 0
    assert edit("relabel", dataset, "where=tag == 'odd'", "tag=odder") == 0
    again = read_episode(dataset / "failures" / f"{victim.uid}.mcap")
    assert [each["was"]["tag"] for each in again.provenance["relabelled"]] == ["", "odd"]
    assert edit("undo", dataset) == 0
    assert edit("undo", dataset) == 0
    assert digests(dataset) == before


def test_a_copy_that_shares_files_is_not_edited(dataset: Path, tmp_path: Path) -> None:
    out = tmp_path / "shared"
    assert edit("filter", dataset, "where=success", f"out={out}") == 0
    before = digests(out)
    assert edit("relabel", dataset, "where=success", "tag=seen") == 0
    assert edit("delete", dataset, "where=seed > 3") == 0
    assert digests(out) == before
    assert not altered_files(out)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["delete", "where=steps > 999"], "holds for none of 12"),
        (["delete", "where=steps > seconds_"], "Unknown column 'seconds_'"),
        (["relabel", "where=success"], "Say what to change"),
        (["delete", "where=uid.__class__"], "has a attribute in it"),
    ],
)
def test_bad_words_change_nothing(
    words: list[str], said: str, dataset: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = digests(dataset)
    assert edit(words[0], dataset, *words[1:]) == 2
    assert said in capsys.readouterr().err
    assert digests(dataset) == before
    assert not (dataset / "trash").exists()


def test_only_a_person_has_a_name(cranes: Recorded, capsys: pytest.CaptureFixture[str]) -> None:
    assert edit("relabel", cranes(0, 6), "where=success", "operator=ana") == 2
    assert "was flown by expert, not by a person" in capsys.readouterr().err


def test_what_is_not_ours_is_not_edited(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (theirs := tmp_path / "theirs" / "demos").mkdir(parents=True)
    (theirs / "film.mcap").write_bytes(b"precious")
    assert edit("delete", theirs.parent, "where=success") == 2
    assert (theirs / "film.mcap").read_bytes() == b"precious"
    assert edit("delete", next(dataset.glob("demos/*")), "where=success") == 2
    assert "nothing else can be edited" in capsys.readouterr().err
    (dataset / "trash").symlink_to(theirs.parent)
    assert edit("delete", dataset, "where=success") == 2
    assert "is a link" in capsys.readouterr().err


@pytest.mark.parametrize(
    "changed",
    [
        {"state": "other"},
        {"labels": {"success": "yes"}},
        {"labels": {"unknown": 1}},
        {"episodes": {"../../precious": {"kind": "demos", "sha256": "", "to": None}}},
        {"episodes": {"x": {"kind": "../..", "sha256": "", "to": None}}},
        {"episodes": [1]},
    ],
)
@pytest.mark.parametrize("state", ["started", "done"])
def test_a_note_of_somebody_else_moves_nothing(
    changed: dict, state: str, dataset: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (precious := dataset.parent / "precious.mcap").write_bytes(b"precious")
    assert edit("delete", dataset, "where=seed == 3") == 0
    note = dataset / "trash" / "0001" / "edit.json"
    note.write_text(json.dumps({**json.loads(note.read_text()), "state": state, **changed}))
    before = digests(dataset)
    assert edit("undo", dataset) == 2
    assert "Traceback" not in capsys.readouterr().err
    assert precious.read_bytes() == b"precious"
    assert {name: digest for name, digest in digests(dataset).items() if "mcap" in name}.items() <= before.items()


def test_no_edit_goes_through_a_link(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert edit("delete", dataset, "where=seed == 3") == 0
    (dataset / "trash" / "0001").rename(tmp_path / "elsewhere")
    (dataset / "trash" / "0001").symlink_to(tmp_path / "elsewhere")
    assert edit("undo", dataset) == 2
    assert "is a link" in capsys.readouterr().err


def test_no_column_is_written_through_a_link(dataset: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (dataset / "columns").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InvalidValueError, match="columns is a link"):
        write_column(dataset, "quality", {open_dataset(dataset)[0].uid: 0.5})
    assert not [*(tmp_path / "elsewhere").iterdir()]


def test_undo_loses_no_episode_that_was_flown_again(dataset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    victim = open_dataset(dataset)[0].uid
    assert edit("delete", dataset, f"where=uid == '{victim}'") == 0
    again = dataset / "demos" / f"{victim}.mcap"
    again.write_bytes((dataset / "trash" / "0001" / "demos" / again.name).read_bytes() + b"again")
    assert edit("undo", dataset) == 2
    assert "was recorded anew" in capsys.readouterr().err
    assert again.read_bytes().endswith(b"again")
    again.unlink()
    assert edit("undo", dataset) == 0
    assert edit("validate", dataset) == 0


def test_a_full_disk_names_the_file_and_the_command_goes_on(dataset: Path) -> None:
    before = digests(dataset)
    words = ["relabel", str(dataset), "where=success", "tag=seen", QUIET]
    most = str(max(file.stat().st_size for file in dataset.glob("demos/*")) // 2)
    done = subprocess.run([sys.executable, "-c", LIMITED, most, *words], capture_output=True, text=True, check=False)
    assert done.returncode in (1, 2)
    assert ".mcap.part: cannot be written" in done.stderr
    assert "Traceback" not in done.stderr
    assert main(words) == 0
    assert {row["tag"] for row in read_table(open_dataset(dataset))} == {"seen"}
    assert edit("undo", dataset) == 0
    assert digests(dataset) == before


@pytest.mark.slow
@pytest.mark.parametrize("words", [["delete"], ["relabel", "success=true", "tag=seen"]])
def test_a_killed_edit_is_finished_or_taken_back(words: list[str], cranes: Recorded, tmp_path: Path) -> None:
    source, rename = cranes(0, 12, "human:ana"), 0
    whole = Path(shutil.copytree(source, tmp_path / "whole"))
    asked = ["where=not success", *words[1:]]
    assert edit(words[0], whole, *asked) == 0
    while True:
        finished, back = (Path(shutil.copytree(source, tmp_path / f"{name}{rename}")) for name in ("a", "b"))
        if not killed_at(rename, [words[0], str(finished), *asked, QUIET]):
            break
        assert killed_at(rename, [words[0], str(back), *asked, QUIET])
        begun = bool(list(finished.glob("trash/*/edit.json")))
        assert edit(words[0], finished, *asked) == 0
        assert digests(finished) == digests(whole)
        assert edit("undo", back) == (0 if begun else 2)
        assert digests(back) == digests(source)
        rename += 1
    assert rename > 5


@pytest.mark.slow
def test_a_killed_undo_is_finished(dataset: Path, tmp_path: Path) -> None:
    before, rename = digests(dataset), 0
    assert edit("relabel", dataset, "where=not success", "success=true") == 0
    while True:
        copy = Path(shutil.copytree(dataset, tmp_path / f"copy{rename}"))
        if not killed_at(rename, ["undo", str(copy), QUIET]):
            break
        assert edit("undo", copy) == 0
        assert digests(copy) == before
        rename += 1
    assert rename > 4


def test_words_of_its_own_are_relabelled_too(dataset: Path, tmp_path: Path) -> None:
    """As an episode has them that came out of a dataset whose episodes were told different things."""
    episode, folder = open_dataset(dataset)[0], DatasetFolder(tmp_path / "told")
    write_episode(replace(episode, provenance={**episode.provenance, "instruction": "Pick."}), folder.file(episode.uid))
    folder.write_index(episode.spec)
    (row,) = read_table(open_dataset(folder.path))
    assert row["instruction"] == "Pick."
    assert edit("relabel", folder.path, "where=success", "instruction=Press the bell.") == 0
    (again,) = open_dataset(folder.path)
    assert again.instruction == "Press the bell."
    assert again.provenance["relabelled"][0]["was"]["instruction"] == "Pick."


def test_an_export_is_made_anew_after_an_edit_and_after_it_was_taken_back(dataset: Path) -> None:
    was = open_dataset(dataset)[0].instruction
    for words, now in (
        ((), was),
        (("relabel", "where=success", "instruction=A typing error."), "A typing error."),
        (("undo",), was),
    ):
        if words:
            assert edit(words[0], dataset, *words[1:]) == 0
        assert edit("convert", dataset) == 0
        assert open_dataset(dataset / "derived" / "lerobot")[0].instruction == now


def test_what_some_flights_alone_say_can_be_asked_for(dataset: Path) -> None:
    last = open_dataset(dataset, failures=True).uids[-1]
    assert edit("relabel", dataset, f"where=uid == '{last}'", "tag=odd") == 0
    (row,) = select(open_dataset(dataset, failures=True), "relabelled != None")
    assert row["uid"] == last


def test_a_crash_is_not_called_a_success(dataset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No reader would believe it, and the flight would be gone from every training."""
    before = digests(dataset)
    assert edit("relabel", dataset, "where=failure == 'crash'", "success=true") == 2
    assert "ended in a crash. Leave such out: where=\"failure != 'crash'\"" in capsys.readouterr().err
    assert digests(dataset) == before
