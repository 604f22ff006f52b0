"""A folder for a hub, and what is handed to lerobot to push it; nothing here goes online."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from huggingface_hub import DatasetCard, HfApi
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from aerial_il.cli.main import main
from aerial_il.data.dataset import open_dataset
from tests.curation.conftest import QUIET, digests

TOKEN = "hf_secretsecretsecret"
LICENSED = ["license=cc-by-4.0", "films=0", QUIET]
Published = Callable[..., int]


@pytest.fixture
def published(dataset: Path, tmp_path: Path) -> Published:
    """Return a function that publishes the dataset and returns the status."""
    return lambda *more: main(["publish", str(dataset), f"out={tmp_path / 'hub'}", *LICENSED, *more])


@pytest.fixture
def pushed(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """What lerobot and the hub are asked to do, instead of doing it."""
    asked: list[dict[str, Any]] = []

    def push_to_hub(self: LeRobotDataset, **said: Any) -> None:
        asked.append({"repo": self.repo_id, "root": Path(self.root), "frames": self.num_frames, **said})

    def upload_file(self: HfApi, **said: Any) -> None:
        asked.append({**said, "text": Path(said["path_or_fileobj"]).read_text()})

    monkeypatch.setattr(LeRobotDataset, "push_to_hub", push_to_hub)
    monkeypatch.setattr(HfApi, "upload_file", upload_file)
    monkeypatch.setenv("HF_TOKEN", TOKEN)
    monkeypatch.setenv("HF_HUB_OFFLINE", "0")
    return asked


def test_the_folder_is_a_lerobot_dataset_with_a_card(published: Published, dataset: Path, tmp_path: Path) -> None:
    before = digests(dataset)
    assert published() == 0
    hub = tmp_path / "hub"
    assert {entry.name for entry in hub.iterdir()} == {"meta", "data", "README.md", "card.html"}
    successes = open_dataset(dataset)
    assert open_dataset(hub).uids == successes.uids
    front = DatasetCard((hub / "README.md").read_text()).data.to_dict()
    assert (front["license"], front["task_categories"], front["tags"][0]) == ("cc-by-4.0", ["robotics"], "LeRobot")
    assert f"| episodes | {len(successes)}, of which" in (hub / "README.md").read_text()
    assert digests(dataset) == before
    whole = (hub / "meta" / "provenance.json").stat().st_mtime_ns
    assert published() == 0, "the same command again"
    assert (hub / "meta" / "provenance.json").stat().st_mtime_ns == whole


def test_without_a_licence_it_names_them(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words in ([], ["license=mine"]):
        assert main(["publish", str(dataset), f"out={tmp_path / 'hub'}", *words]) == 2
        said = capsys.readouterr().err
        assert "cc-by-4.0, " in said
        assert len(said.strip().splitlines()) == 1
    assert not (tmp_path / "hub").exists()


def test_the_push_is_lerobots_own(published: Published, pushed: list[dict[str, Any]], tmp_path: Path) -> None:
    assert published("repo=ana/pick") == 0
    first, second = pushed
    assert (first["repo"], first["root"]) == ("ana/pick", tmp_path / "hub")
    assert first["license"] == "cc-by-4.0"
    assert first["private"] is True
    assert "crane" in first["tags"]
    assert first["frames"] == sum(map(len, open_dataset(tmp_path / "hub")))
    assert (second["repo_id"], second["path_in_repo"], second["repo_type"]) == ("ana/pick", "README.md", "dataset")
    assert 'LeRobotDataset("ana/pick")' in second["text"], "the hub shows ours, not the one that lerobot has written"


def test_no_token_no_push(
    published: Published, pushed: list[dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("HF_TOKEN")
    assert published("repo=ana/pick") == 2
    monkeypatch.setenv("HF_TOKEN", TOKEN)
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    assert published("repo=ana/pick") == 2
    assert published("repo=../pick") == 2
    assert not pushed
    assert not (tmp_path / "hub").exists(), "that is said before anything is made"


def test_a_refusal_of_the_hub_keeps_folder_and_token(
    published: Published,
    pushed: list[dict[str, Any]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    def refuse(self: LeRobotDataset, **said: Any) -> None:
        raise RuntimeError(f"401 for Bearer {TOKEN}")

    monkeypatch.setattr(LeRobotDataset, "push_to_hub", refuse)
    assert published("repo=ana/pick") == 2
    said = "".join(capfd.readouterr())
    assert "401 for Bearer ***" in said
    assert TOKEN not in said
    assert (tmp_path / "hub" / "card.html").exists()
    assert not any(TOKEN.encode() in file.read_bytes() for file in (tmp_path / "hub").rglob("*") if file.is_file())


def test_what_is_somebody_elses_is_left_alone(published: Published, tmp_path: Path) -> None:
    hub = tmp_path / "hub"
    hub.mkdir()
    (hub / "README.md").write_text("My words about aerial_il.\n")
    assert published() == 2
    assert [*hub.iterdir()] == [hub / "README.md"]
    (hub / "README.md").unlink()
    assert published() == 0
    own = (hub / "README.md").read_text().replace("# Written by", "# Once written by")
    (hub / "README.md").write_text(own)
    assert published() == 0, "words of one's own stay as long as the data do"
    assert (hub / "README.md").read_text() == own
    (hub / "notes.txt").write_text("precious\n")
    assert published() == 2
    assert (hub / "notes.txt").read_text() == "precious\n"


def test_there_is_nothing_to_publish(
    published: Published, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["publish", str(dataset), f"out={dataset}", *LICENSED]) == 2
    assert main(["relabel", str(dataset), "where=success", "success=false", QUIET]) == 0
    capsys.readouterr()
    assert published() == 2
    assert "no demonstrations" in capsys.readouterr().err
    assert not (tmp_path / "hub").exists()
