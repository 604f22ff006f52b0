"""Datasets that are made of others: what is refused, what is shared, and what is known of where it came from."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from aerial_il.cli.main import main
from aerial_il.data.dataset import altered_files, open_dataset
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.table import read_columns, read_table, write_column
from tests.curation.conftest import QUIET, Recorded, digests

KILLED = """
import os, signal, sys
from aerial_il.cli.main import main
left, real = int(sys.argv[1]), {name: getattr(os, name) for name in ("replace", "link")}
def counted(name):
    def call(*args, **kwargs):
        global left
        if not left:
            os.kill(os.getpid(), signal.SIGKILL)
        left -= 1
        return real[name](*args, **kwargs)
    return call
os.replace, os.link = counted("replace"), counted("link")
sys.exit(main(sys.argv[2:]))
"""


def killed_at(rename: int, words: list[str]) -> bool:
    """Run a command in a process that is killed before one of its renames; return whether it came so far."""
    done = subprocess.run([sys.executable, "-c", KILLED, str(rename), *words], capture_output=True, check=False)
    assert done.returncode in (0, -signal.SIGKILL), done.stderr.decode()
    return done.returncode != 0


def uids(folder: Path) -> set[str]:
    return set(open_dataset(folder, failures=True).uids)


def test_filter_keeps_what_holds_and_shares_the_files(dataset: Path, tmp_path: Path) -> None:
    out = tmp_path / "good"
    assert main(["filter", str(dataset), "where=success and steps > 20", f"out={out}", QUIET]) == 0
    rows = read_table(open_dataset(dataset, failures=True))
    expected = {row["uid"] for row in rows if row["success"] and row["steps"] > 20}
    assert 0 < len(expected) < 12
    assert uids(out) == expected
    for file in out.glob("demos/*.mcap"):
        assert file.samefile(dataset / "demos" / file.name)
    assert not altered_files(out)
    lineage = json.loads((out / "lineage.json").read_text())
    assert (lineage["command"], lineage["where"]) == ("filter", "success and steps > 20")
    assert lineage["sources"][0]["path"] == str(dataset)
    assert main(["validate", str(out), QUIET]) == 0


def test_an_empty_result_says_how_many_each_clause_leaves(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "none"
    assert main(["filter", str(dataset), "where=operator == 'ana' and steps > 999", f"out={out}", QUIET]) == 2
    assert "(operator == 'ana': 12; steps > 999: 0)" in capsys.readouterr().err
    assert not out.exists()


def test_further_columns_are_filtered_by_and_kept(dataset: Path, tmp_path: Path) -> None:
    first, second = sorted(uids(dataset))[:2]
    write_column(dataset, "quality", {first: 0.9, second: 0.1})
    out = tmp_path / "good"
    assert main(["filter", str(dataset), "where=quality > 0.05", f"out={out}", QUIET]) == 0
    assert {row["uid"]: row["quality"] for row in read_table(open_dataset(out, failures=True))} == {
        first: 0.9, second: 0.1,
    }  # fmt: skip


def test_what_any_source_says_of_a_shared_episode_is_kept(cranes: Recorded, tmp_path: Path) -> None:
    one, two = (Path(shutil.copytree(cranes(0, 4), tmp_path / name)) for name in ("one", "two"))
    first, second, *_ = sorted(uids(one))
    write_column(one, "quality", {first: 0.9, second: None})  # None says nothing
    write_column(two, "quality", {first: 0.2, second: 0.1})
    write_column(two, "cuts", {second: "cube:1-5"})
    assert main(["merge", str(one), str(two), f"out={tmp_path / 'both'}", QUIET]) == 0
    assert read_columns(tmp_path / "both") == {"cuts": {second: "cube:1-5"}, "quality": {first: 0.9, second: 0.1}}


def test_two_processes_do_not_build_one_dataset(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["filter", str(dataset), "where=success", f"out={tmp_path / 'good'}", QUIET]
    (tmp_path / "good").mkdir()
    with DatasetFolder(tmp_path / "good").alone():
        assert main(words) == 2
    assert "being edited by another process" in capsys.readouterr().err
    assert not os.listdir(tmp_path / "good")
    assert main(words) == 0


def test_merge_puts_together_and_takes_twins_once(
    cranes: Recorded, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, two, out = cranes(0, 6), cranes(4, 6), tmp_path / "both"
    assert main(["merge", str(one), str(two), f"out={out}", QUIET]) == 0
    assert uids(out) == uids(one) | uids(two)
    assert "10 episodes of 2 datasets (2 were in several)" in capsys.readouterr().out
    assert not altered_files(out)
    assert main(["merge", str(one), str(two), f"out={out}", QUIET]) == 0, "it is there already"
    assert main(["merge", str(one), str(cranes(20, 3)), f"out={out}", QUIET]) == 2
    assert "holds a dataset already" in capsys.readouterr().err


def test_what_differs_is_named(cranes: Recorded, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = [str(cranes(0, 6)), f"out={tmp_path / 'both'}", QUIET]
    assert main(["merge", str(cranes(0, 3, max_steps=60)), *words]) == 2
    assert "max_steps: 60 != 120" in capsys.readouterr().err
    noisy = str(cranes(0, 3, noise=0.01))
    assert main(["merge", noisy, *words]) == 2
    assert "settings.noise 0.01 != 0.0" in capsys.readouterr().err
    assert main(["merge", str(cranes(0, 3, "human:ben")), *words]) == 2
    told = capsys.readouterr().err
    assert "policy human:ben != expert" in told
    assert "out=PATH" not in told
    assert not (tmp_path / "both").exists()
    assert main(["merge", noisy, *words, "mix=true"]) == 0
    assert len(uids(tmp_path / "both")) == 9
    assert main(["merge", noisy, QUIET, "out=alone"]) == 2
    assert "name two or more" in capsys.readouterr().err


def test_a_relabelled_twin_is_refused(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = Path(shutil.copytree(dataset, tmp_path / "other"))
    assert main(["relabel", str(other), "where=seed == 3", "tag=odd", QUIET]) == 0
    assert main(["merge", str(dataset), str(other), f"out={tmp_path / 'both'}", QUIET]) == 2
    assert "different episodes of one name" in capsys.readouterr().err


def test_other_formats_are_recorded_anew(cranes: Recorded, tmp_path: Path) -> None:
    for first in (0, 20):
        out = tmp_path / f"{first}.hdf5"
        assert main(["convert", str(cranes(first, 4)), f"out={out}", QUIET]) == 0
    both = tmp_path / "both"
    assert main(["merge", str(tmp_path / "0.hdf5"), str(tmp_path / "20.hdf5"), f"out={both}", QUIET]) == 0
    there = [*open_dataset(tmp_path / "0.hdf5"), *open_dataset(tmp_path / "20.hdf5")]
    merged = list(open_dataset(both, failures=True))
    assert [len(e) for e in merged] == [len(e) for e in there]
    assert all((m.actions == e.actions).all() for m, e in zip(merged, there, strict=True))
    assert merged[0].provenance["source"]["uid"] == there[0].uid


def test_sets_without_states_are_filtered_split_and_merged(
    cranes: Recorded, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    there = [tmp_path / "lerobot0", tmp_path / "lerobot20"]
    for first, place in zip((0, 20), there, strict=True):
        assert main(["convert", str(cranes(first, 6)), f"out={place}", QUIET]) == 0
    few, parts, both = (tmp_path / name for name in ("few", "parts", "both"))
    assert main(["filter", str(there[0]), "where=steps > 0", f"out={few}", QUIET]) == 0
    assert main(["split", str(there[0]), f"out={parts}", "parts=[a=0.5,b=0.5]", QUIET]) == 0
    assert main(["merge", *map(str, there), f"out={both}", QUIET]) == 0
    assert uids(few) == uids(there[0]) == uids(parts / "a") | uids(parts / "b")
    assert all(not episode.states.size for episode in open_dataset(both))
    assert main(["validate", str(both), QUIET]) == 0
    assert main(["merge", str(there[0]), str(cranes(20, 6)), f"out={tmp_path / 'no'}", QUIET]) == 2
    assert "state_size" in capsys.readouterr().err


def test_a_split_is_disjoint_stratified_and_the_same_again(cranes: Recorded, tmp_path: Path) -> None:
    source, words = cranes(0, 40), ["parts=[train=0.5,validation=0.25,test=0.25]", QUIET]
    for name, seed in (("one", 1), ("again", 1), ("other", 2)):
        assert main(["split", str(source), f"out={tmp_path / name}", f"seed={seed}", *words]) == 0
    parts = {name: uids(tmp_path / "one" / name) for name in ("train", "validation", "test")}
    assert set.union(*parts.values()) == uids(source)
    assert [len(part) for part in parts.values()] == [20, 10, 10]
    assert {name: uids(tmp_path / "again" / name) for name in parts} == parts
    assert uids(tmp_path / "other" / "train") != parts["train"]
    won = {name: sum(e.success for e in open_dataset(tmp_path / "one" / name, failures=True)) for name in parts}
    assert abs(won["train"] - won["validation"] - won["test"]) <= 2
    assert abs(won["validation"] - won["test"]) <= 2


@pytest.mark.parametrize(
    "parts",
    [
        "[train=0.8]",
        "[a=0.5,b=0.6]",
        "[a=0.5,a=0.5]",
        "[a=x,b=0.5]",
        "[../a=0.5,b=0.5]",
        "[a=-0.5,b=1.5]",
        "[a=0.999,b=0.001]",
    ],
)
def test_parts_that_are_none_are_refused(parts: str, cranes: Recorded, tmp_path: Path) -> None:
    out = tmp_path / "parts"
    assert main(["split", str(cranes(0, 6)), f"parts={parts}", f"out={out}", QUIET]) == 2
    assert not out.exists()


def test_what_lies_where_parts_would_is_left_alone(dataset: Path, tmp_path: Path) -> None:
    (theirs := tmp_path / "theirs").mkdir()
    (theirs / "notes").write_text("precious")
    for name in ("copied", "linked"):
        (out := tmp_path / name).mkdir()
        if name == "copied":
            shutil.copytree(theirs, out / ".part")
        else:
            (out / ".part").symlink_to(theirs)
        assert main(["filter", str(dataset), "where=success", f"out={out}", QUIET]) == 2
        assert os.listdir(out) == [".part"]
        assert (out / ".part" / "notes").exists()
    assert (theirs / "notes").read_text() == "precious"
    assert os.listdir(theirs) == ["notes"]


@pytest.mark.slow
def test_a_killed_merge_leaves_no_dataset_and_starts_over(cranes: Recorded, tmp_path: Path) -> None:
    one, two = cranes(0, 6), cranes(20, 3)
    words = [str(one), str(two), QUIET]
    assert main(["merge", *words, f"out={tmp_path / 'whole'}"]) == 0
    for rename in (0, 1, 5, 10, 11, 12, 13):
        out = tmp_path / str(rename)
        assert killed_at(rename, ["merge", *words, f"out={out}"])
        assert not (out / "demos").exists() or (out / "dataset.yaml").exists()
        assert main(["merge", *words, f"out={out}"]) == 0
        assert digests(out) == digests(tmp_path / "whole")
        assert {name for name in os.listdir(out) if not name.endswith(".tmp")} == {*os.listdir(tmp_path / "whole")}


def test_what_others_changed_is_another_source(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, out = tmp_path / "theirs.npz", tmp_path / "good"
    words = ["filter", str(source), "where=steps > 0", f"out={out}", QUIET]
    rows = {"acts": np.zeros((6, 1)), "dones": np.arange(6) == 5}
    np.savez(source, obs=np.zeros((6, 2)), next_obs=np.zeros((6, 2)), **rows)
    assert main(words) == main(words) == 0
    np.savez(source, obs=np.ones((6, 2)), next_obs=np.ones((6, 2)), **rows)
    capsys.readouterr()
    assert main(words) == 2
    assert "holds a dataset already" in capsys.readouterr().err
    assert not open_dataset(out)[0].flat_obs(open_dataset(out).spec.observation.state_names).any()
