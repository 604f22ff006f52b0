"""Cuts by hand: by script and on a page, kept beside the flights, taken back, and flown by what is generated."""

import asyncio
import json
import shutil
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from aerial_il.cli.main import main
from aerial_il.data.curation import edits
from aerial_il.data.dataset import open_dataset
from aerial_il.generation.source import source_of
from aerial_il.workflows.parts.segment_server import SegmentServer
from aerial_il.workflows.segment import Segmentation, segment
from tests.curation.test_browse import ask
from tests.teleop.chromium import browser, needs_browser

pytestmark = pytest.mark.usefixtures("no_commit")


@pytest.fixture
def one(shown: Callable[[str], Path], tmp_path: Path) -> Path:
    """A copy of one flight."""
    return Path(shutil.copytree(shown("pick_place"), tmp_path / "one"))


@pytest.fixture
def server(one: Path) -> Iterator[SegmentServer]:
    with SegmentServer(str(one), open_dataset(one).uids, 0) as served:
        thread = threading.Thread(target=served.serve_forever, daemon=True)
        thread.start()
        yield served
        served.shutdown()
        thread.join()


class Killed(BaseException):
    """What ends a process at once."""


def kill(*_: object) -> None:
    raise Killed


def standing(dataset: Path) -> str:
    """Return the cuts of the one flight as they stand."""
    (cuts,) = segment(Segmentation(dataset=str(dataset), page=False)).values()
    return ", ".join(map(str, cuts))


def uid_of(dataset: Path) -> str:
    return open_dataset(dataset).uids[0]


def steps_of(dataset: Path) -> int:
    return len(open_dataset(dataset)[0])


def test_cuts_by_script_are_kept_printed_and_taken_back(one: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found, steps = standing(one), steps_of(one)
    assert main(["segment", str(one), f"cuts=[cube:30-90,bowl:120-{steps}]"]) == 0
    assert f"{uid_of(one)}: cube:30-90, bowl:120-{steps}" in capsys.readouterr().out
    assert main(["segment", str(one), "cuts=[cube:31-90]"]) == 0
    assert main(["undo", str(one), "progress=false"]) == 0
    assert "given other cuts" in capsys.readouterr().out
    assert standing(one) == f"cube:30-90, bowl:120-{steps}"
    assert main(["segment", str(one), "cuts=[found]"]) == 0
    assert standing(one) == found
    for _ in range(2):
        assert main(["undo", str(one), "progress=false"]) == 0
    assert standing(one) == found
    assert not list(one.glob("columns/*"))
    assert not (one / "trash").exists()


def test_cuts_lie_where_phases_change(one: Path) -> None:
    episode = open_dataset(one)[0]
    names = episode.provenance["phases"]
    begins = {names[phase]: step for step, phase in reversed(list(enumerate(episode.phase)))}
    assert main(["segment", str(one), "cuts=[phases]"]) == 0
    descend, carry, lower = (begins[name] for name in ("descend", "carry", "lower"))
    assert standing(one) == f"cube:{descend}-{carry}, bowl:{lower}-{len(episode)}"


@pytest.mark.parametrize(
    ("cuts", "said"),
    [
        ("[cube:30-90,bowl:80-150]", "bowl:80-150 begins before cube:30-90 ends"),
        ("[bowl:100-150,cube:30-90]", "cube:30-90 begins before bowl:100-150 ends"),
        ("[cube:30-9000]", "cube:30-9000 is outside of the flight: 0 <= FIRST < LAST <= "),
        ("[cube:30-30]", "cube:30-30 is outside"),
        ("[cup:30-90]", "Unknown thing 'cup'. Did you mean 'cube'? Valid: cube, bowl."),
        ("[cube]", "'cube' is no cut. Type THING:FIRST-LAST in steps, such as cube:40-95."),
        ("[]", "A flight without a cut shows nothing"),
    ],
)
def test_cuts_that_cannot_be_are_refused(one: Path, cuts: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    before = sorted(one.rglob("*"))
    assert main(["segment", str(one), f"cuts={cuts}"]) == 2
    assert said in capsys.readouterr().err
    assert sorted(one.rglob("*")) == before


def test_what_cannot_be_cut_is_said(one: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["segment", str(one), "uid=x", "page=false"]) == 2
    assert f"Unknown successful flight 'x'. Valid: {uid_of(one)}" in capsys.readouterr().err
    assert main(["segment", str(one), "cuts=[cube:30-90]"]) == 0
    (one / "columns" / "cuts.json").write_text(json.dumps({uid_of(one): "cube"}))
    for words in (["segment", str(one), "page=false"], ["generate", f"dataset={one}", f"out={one}2"]):
        assert main(words) == 2
        assert "cuts.json: cannot be used ('cube' is no cut" in capsys.readouterr().err
    (one / "columns" / "cuts.json").write_text(json.dumps({uid_of(one): "cube:1-9999"}))
    assert main(["generate", f"dataset={one}", f"out={one}2"]) == 2
    assert f"{uid_of(one)} cannot be cut as was said: cube:1-9999 is outside" in capsys.readouterr().err
    assert main(["segment", str(one), f"uid={uid_of(one)}", "cuts=[found]"]) == 0


def test_an_edit_that_was_killed_is_finished_or_taken_back(one: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = standing(one)
    for then, after in (("segment", "cube:31-91"), ("undo", found)):
        with monkeypatch.context() as patch:
            patch.setattr(edits, "write_column", kill)
            with pytest.raises(Killed):
                main(["segment", str(one), "cuts=[cube:30-90]"])
        assert standing(one) == found
        words = ["cuts=[cube:31-91]"] if then == "segment" else ["progress=false"]
        assert main([then, str(one), *words]) == 0
        assert standing(one) == after
        if then == "segment":
            assert main(["undo", str(one), "progress=false"]) == 0
            assert standing(one) == "cube:30-90", "the edit that was killed was finished first"
            assert main(["undo", str(one), "progress=false"]) == 0


def test_what_is_generated_is_cut_as_it_was_said(one: Path, tmp_path: Path) -> None:
    steps = steps_of(one)
    cuts = f"cube:20-90, bowl:110-150, bowl:150-{steps}"
    assert main(["segment", str(one), f"cuts=[{cuts.replace(' ', '')}]"]) == 0
    out = tmp_path / "many"
    assert main(["generate", f"dataset={one}", f"out={out}", "episodes=4", "threads=1", "progress=false"]) == 0
    flights = list(open_dataset(out))
    assert len(flights) >= 3
    for flight in flights:
        assert flight.provenance["settings"]["cuts"] == {uid_of(one): cuts}
        made = flight.provenance["made_of"]["segments"]
        assert [each["source_steps"] for each in made] == [[20, 90], [110, 150], [150, steps]]


def test_flights_of_one_name_in_two_folders_have_their_own_cuts(one: Path, tmp_path: Path) -> None:
    both, uid = tmp_path / "both", uid_of(one)
    for name, cut in (("a", "cube:40-95"), ("b", "cube:50-95")):
        shutil.copytree(one, both / name)
        assert main(["segment", str(both / name), f"cuts=[{cut}]"]) == 0
    assert main(["relabel", str(both / "b"), "where=success", "tag=other", "progress=false"]) == 0
    dataset = open_dataset(both)
    found = {name: str(source_of(dataset, name).cuts[0]) for name in dataset.uids}
    assert found == {uid: "cube:40-95", f"b-{uid}": "cube:50-95"}


def test_the_page_keeps_what_is_said_and_takes_it_back(server: SegmentServer, one: Path) -> None:
    uid, found = uid_of(one), standing(one)
    cuts = ["cube:30-90", f"bowl:120-{steps_of(one)}"]
    status, text = ask(server, "/save", {"uid": uid, "cuts": cuts})
    assert (status, json.loads(text)["by_hand"], standing(one)) == (200, True, ", ".join(cuts))
    for wrong in (cuts[::-1], ["cup:30-90"], ["cube:-1-90"], ["cube:30-95.5"], ["cube"], [], "cube", [1], None, {}):
        assert ask(server, "/save", {"uid": uid, "cuts": wrong})[0] == 400
    assert ask(server, "/save", {"uid": "x", "cuts": cuts})[0] == 400
    assert ask(server, "/save", {"uid": uid, "cuts": ["found"]}, token="guessed")[0] == 403
    status, text = ask(server, "/undo", {"uid": uid})
    assert (status, json.loads(text)["by_hand"], standing(one)) == (200, False, found)
    assert ask(server, "/undo", {"uid": uid})[0] == 400
    assert main(["relabel", str(one), "where=success", "tag=mine", "progress=false"]) == 0
    status, text = ask(server, "/undo", {"uid": uid})
    assert (status, "The last edit is no cut: 1 episodes were relabelled" in text) == (400, True)


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.render
@needs_browser
def test_a_person_moves_divides_and_saves_on_the_page(server: SegmentServer, one: Path) -> None:
    found, steps = standing(one), steps_of(one)

    async def flow() -> list[str]:
        async with browser() as open_page:
            tab = await open_page(server.url)
            await tab.until("$('film').readyState >= 2")
            await tab.value("$('last-0').focus()")
            await tab.tap("ArrowRight")
            await tab.value("$('thing').value = 'bowl'; $('thing').onchange()")
            assert await tab.value("dirty")
            assert standing(one) == found, "what is not saved is not kept"
            assert await tab.value("$('making').hidden"), "the film is there"
            await tab.value("confirm = () => false; $('flight').append(new Option('other'))")
            await tab.value("$('flight').value = 'other'; $('flight').onchange()")
            assert await tab.value("dirty && $('flight').value === flight.uid"), "who stays loses nothing"
            await tab.value("seek(150); $('add').click()")
            await tab.value("move(2, 'first', 0)")
            assert await tab.value("cuts[2].first === cuts[1].last"), "an edge stays behind the one before it"
            await tab.value("chosen = 0; draw(); $('remove').click(); $('save').click()")
            await tab.until("flight.by_hand")
            await tab.value("$('flight').value = 'other'; $('flight').onchange()")
            await tab.until("$('problem').textContent")
            shown = "cuts.length || flight || !$('save').disabled || $('cuts').childElementCount"
            assert not await tab.value(shown), "of a flight that cannot be opened nothing is shown, nor another's cuts"
            return tab.errors

    assert not asyncio.run(flow())
    assert standing(one).endswith(f"-150, bowl:150-{steps}")
    assert standing(one).startswith("bowl:")
