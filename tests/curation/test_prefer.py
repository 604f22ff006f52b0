"""Preferences by command and by hand: the page, what its server lets pass, and that both go on where they stopped."""

import asyncio
import json
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from aerial_il.cli.main import main
from aerial_il.data.dataset import open_dataset
from aerial_il.data.preferences.file import PreferenceFile, read_preferences
from aerial_il.data.preferences.pairs import draw_pairs
from aerial_il.workflows.parts.prefer_server import PreferServer
from tests.curation.conftest import QUIET
from tests.curation.test_browse import ask
from tests.teleop.chromium import browser, needs_browser

PAIRS = 3


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "said.jsonl"


@pytest.fixture
def server(dataset: Path, out: Path) -> Iterator[PreferServer]:
    lengths = {episode.uid: len(episode) for episode in open_dataset(dataset, failures=True)}
    pairs = draw_pairs(lengths, PAIRS, length=10, seed=0)
    with PreferenceFile(out, lengths) as file, PreferServer(str(dataset), pairs, file, 0) as served:
        thread = threading.Thread(target=served.serve_forever, daemon=True)
        thread.start()
        yield served
        served.shutdown()
        thread.join()


def prefer(dataset: Path, out: Path, *words: str) -> int:
    return main(["prefer", str(dataset), "length=10", f"out={out}", QUIET, *words])


def test_the_command_goes_on_where_it_stopped(
    dataset: Path, out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = tmp_path / "whole.jsonl"
    assert prefer(dataset, whole, "pairs=30") == 0
    assert f"algorithm=cpl algorithm.preferences={whole} run=" in capsys.readouterr().out
    assert prefer(dataset, out, "pairs=12") == 0
    assert len(read_preferences(out)) == 12
    out.write_bytes(out.read_bytes()[:-5])
    assert prefer(dataset, out, "pairs=30") == 0
    assert out.read_bytes() == whole.read_bytes()


def test_bad_settings_and_files_are_answered(
    dataset: Path, out: Path, cranes: object, capsys: pytest.CaptureFixture[str]
) -> None:
    assert prefer(dataset, out.with_suffix(".txt"), "pairs=2") == 2
    assert "must end in .jsonl" in capsys.readouterr().err
    assert prefer(dataset, out, "by=me") == 2
    assert "script, hand" in capsys.readouterr().err
    assert prefer(dataset, out, "flipped=1.5") == 2
    assert "flipped is 1.5" in capsys.readouterr().err
    assert prefer(dataset, out, "pairs=3") == 0
    text = out.read_text().replace("crane", "plane")
    out.write_text(text)
    assert prefer(dataset, out, "pairs=4") == 2
    assert "it was made for another one" in capsys.readouterr().err
    assert out.read_text() == text


def test_answers_are_kept_once_and_in_the_file(server: PreferServer, out: Path) -> None:
    for number, preferred in enumerate(("left", "equal", "right")):
        status, text = ask(server, "/say", {"pair": number, "preferred": preferred})
        said = {"left": [*range(PAIRS)][number + 1 :][:2], "said": number + 1, "pairs": PAIRS}
        assert (status, json.loads(text)) == (200, said)
    assert ask(server, "/say", {"pair": 0, "preferred": "right"})[0] == 200
    found = read_preferences(out)
    assert [each.preferred for each in found] == ["left", "equal", "right"]
    assert {each.by for each in found} == {"hand"}
    assert ask(server, "/")[0] == 200, "a page without a pair that is left is shown, too"


@pytest.mark.parametrize(
    "asked",
    [
        {"pair": 0, "preferred": "both"},
        {"pair": 0, "preferred": None},
        {"pair": 0},
        {"pair": -1, "preferred": "left"},
        {"pair": PAIRS, "preferred": "left"},
        {"pair": True, "preferred": "left"},
        {"pair": "0", "preferred": "left"},
        {"preferred": "left"},
        [1],
        "{",
    ],
)
def test_bad_answers_are_refused_and_keep_nothing(server: PreferServer, out: Path, asked: object) -> None:
    for path in ("/say", "/film"):
        assert ask(server, path, asked)[0] == 400
    assert read_preferences(out) == []


def test_who_knows_no_token_may_not_answer(server: PreferServer, out: Path) -> None:
    assert ask(server, "/say", {"pair": 0, "preferred": "left"}, token="guessed")[0] == 403
    assert read_preferences(out) == []


@pytest.mark.render
def test_a_film_shows_the_segment_alone(tmp_path: Path, out: Path) -> None:
    words = ["robot=quad", "task=hover", "horizon=60", "episodes=2", f"out={tmp_path / 'hover'}"]
    assert main(["collect", *words, QUIET]) == 0
    lengths = {episode.uid: len(episode) for episode in open_dataset(tmp_path / "hover", failures=True)}
    pairs = draw_pairs(lengths, 1, length=10, seed=0)
    with (
        PreferenceFile(out, lengths) as file,
        PreferServer(str(tmp_path / "hover"), pairs, file, 0) as served,
    ):
        brief = served.answer("/film", {"pair": 0, "side": "left"})
        whole = served.film(pairs[0][0].uid)
    assert isinstance(brief, bytes)
    assert brief[4:8] == whole[4:8] == b"ftyp"
    assert len(brief) < len(whole)


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.render
@needs_browser
def test_keys_answer_and_the_page_goes_on_after_it_is_closed(tmp_path: Path, out: Path) -> None:
    words = ["robot=quad", "task=hover", "horizon=30", "episodes=3", f"out={tmp_path / 'hover'}"]
    assert main(["collect", *words, QUIET]) == 0
    lengths = {episode.uid: len(episode) for episode in open_dataset(tmp_path / "hover", failures=True)}
    pairs = draw_pairs(lengths, 2, length=10, seed=0)

    async def flow(url: str, key: str, said: int) -> list[str]:
        async with browser() as open_page:
            tab = await open_page(url)
            await tab.until("ready")
            await tab.value(f"document.dispatchEvent(new KeyboardEvent('keydown', {{key: '{key}'}}))")
            await tab.until(f"state.said === {said}")
            return tab.errors

    with PreferenceFile(out, lengths) as file, PreferServer(str(tmp_path / "hover"), pairs, file, 0) as served:
        thread = threading.Thread(target=served.serve_forever, daemon=True)
        thread.start()
        for said, key in enumerate(("ArrowRight", "ArrowDown"), start=1):
            assert not asyncio.run(flow(served.url, key, said))
        served.shutdown()
        thread.join()
    assert [each.preferred for each in read_preferences(out, lengths)] == ["right", "equal"]
