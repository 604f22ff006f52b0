"""Folders of datasets, recordings that were renamed, and edits since: nothing is lost, and nothing mixed up."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from aerial_il.cli.main import main
from aerial_il.collection.collect import collect
from aerial_il.data.curation.splitting import split
from aerial_il.data.dataset import altered_files, open_dataset
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.table import read_table, write_column
from tests.curation.conftest import QUIET, Recorded, digests
from tests.data.crane import CraneBatch, CraneExpert


@pytest.fixture
def two(cranes: Recorded, tmp_path: Path) -> Path:
    """Two copies of four flights in one folder, those of the second one with a tag of their own."""
    for name in "ab":
        shutil.copytree(cranes(0, 4), tmp_path / "two" / name)
    assert main(["relabel", str(tmp_path / "two" / "b"), "where=seed >= 0", "tag=good", QUIET]) == 0
    return tmp_path / "two"


def test_a_recording_goes_by_the_name_of_its_file(dataset: Path, tmp_path: Path) -> None:
    file = DatasetFolder(dataset).files()[0]
    file.rename(file.with_name("renamed.mcap"))
    assert main(["recover", str(dataset)]) == 0
    rows = read_table(open_dataset(dataset, failures=True))
    assert len(rows) == 12
    assert main(["filter", str(dataset), "where=uid == 'renamed'", f"out={tmp_path / 'one'}", QUIET]) == 0
    assert [row["uid"] for row in read_table(open_dataset(tmp_path / "one"))] == ["renamed"]
    assert not altered_files(tmp_path / "one")


def test_flights_of_one_name_keep_their_own_digests_labels_and_columns(two: Path, tmp_path: Path) -> None:
    uid = DatasetFolder(two / "b").files()[0].stem
    for name, verdict in zip("ab", ("poor", "fine"), strict=True):
        write_column(two / name, "verdict", {uid: verdict})
    out = tmp_path / "all"
    assert main(["filter", str(two), "where=seed >= 0", f"out={out}", QUIET]) == 0
    copied = Path(shutil.copytree(out, tmp_path / "copied"))
    for folder in (out, copied):
        assert not altered_files(folder)
        rows = {row["uid"]: row for row in read_table(open_dataset(folder, failures=True))}
        assert len(rows) == 8
        assert sorted(row["tag"] for row in rows.values()) == [""] * 4 + ["good"] * 4
        assert (rows[uid]["verdict"], rows[f"b-{uid}"]["verdict"]) == ("poor", "fine")
        assert (rows[uid]["tag"], rows[f"b-{uid}"]["tag"]) == ("", "good")


def test_flights_of_two_environments_become_no_dataset(
    cranes: Recorded, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(cranes(0, 4), tmp_path / "mixed" / "reach")
    env = CraneBatch(4)
    env.spec = replace(env.spec, task="lift")
    collect(
        env, CraneExpert(), range(3), tmp_path / "mixed" / "lift", policy_name="expert", settings={}, progress=False
    )
    mixed = str(tmp_path / "mixed")
    for words in (["filter", mixed, "where=seed >= 0"], ["split", mixed]):
        assert main([*words, f"out={tmp_path / words[0]}", QUIET]) == 2
        assert "are of different environments and cannot be one dataset" in capsys.readouterr().err
        assert not (tmp_path / words[0]).exists()
    assert main(["judge", mixed, QUIET]) == 2
    assert "crane lift, crane reach" in capsys.readouterr().err
    assert main(["filter", mixed, "where=task == 'lift'", f"out={tmp_path / 'lift'}", QUIET]) == 0
    assert open_dataset(tmp_path / "lift").spec.task == "lift"


def test_what_was_made_before_and_edited_since_says_so(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["filter", str(dataset), "where=seed < 8", f"out={tmp_path / 'some'}", QUIET]
    assert main(words) == 0
    assert main(["delete", str(tmp_path / "some"), "where=seed < 3", QUIET]) == 0
    capsys.readouterr()
    assert main(words) == 0
    said = capsys.readouterr()
    assert "has been edited since: it holds 5 of 8 episodes" in said.err
    assert "some: 5 of 12 episodes" in said.out


@pytest.mark.parametrize("same", [True, False])
def test_an_edit_is_taken_back_where_the_same_was_flown_again_or_nothing_changes(dataset: Path, same: bool) -> None:
    before = digests(dataset)
    assert main(["delete", str(dataset), "where=seed < 2", QUIET]) == 0
    kept = sorted((dataset / "trash").rglob("*.mcap"))[0]
    again = dataset / kept.parent.name / kept.name
    other = next(file for file in dataset.glob("demos/*.mcap"))
    shutil.copy(kept if same else other, again)
    edited = digests(dataset)
    assert main(["undo", str(dataset), QUIET]) == (0 if same else 2)
    assert digests(dataset) == (before if same else edited)
    if not same:
        again.unlink()
        assert main(["undo", str(dataset), QUIET]) == 0, "and it can still be taken back"
        assert digests(dataset) == before


def test_what_came_of_one_flight_is_in_one_part(caplog: pytest.LogCaptureFixture) -> None:
    alike = {"task": "reach", "success": True, "tag": "", "operator": ""}
    rows = [{"uid": f"{k:03d}", **alike} for k in range(60)]
    of = {row["uid"]: f"source {k % 6}" for k, row in enumerate(rows)}
    shares = {"train": 0.5, "test": 0.5}
    parts = split(rows, shares, 3, of=of)
    found = [{of[row["uid"]] for row in part} for part in parts.values()]
    assert not found[0] & found[1]
    assert sum(map(len, parts.values())) == 60
    assert split(rows, shares, 3, of={}) == split(rows, shares, 3)
    assert not caplog.text
    one = split(rows, shares, 3, of=dict.fromkeys(of, "the only one"))
    assert {name: len(part) for name, part in one.items()} == {"train": 30, "test": 30}
    assert "too few flights to keep them apart" in caplog.text
