"""The page that browses: as a file, from its server, and what neither lets pass."""

import asyncio
import json
import re
import shlex
import threading
from collections.abc import Iterator
from html import unescape
from http.client import HTTPConnection
from pathlib import Path

import pytest

from aerial_il.cli.main import main
from aerial_il.data.dataset import open_dataset
from aerial_il.workflows.parts.browse_server import BrowseServer
from aerial_il.workflows.parts.local_server import HEADERS, LocalServer
from tests.curation.conftest import QUIET, digests
from tests.presentation.browser import dom_after
from tests.presentation.outline import needs_nothing_else
from tests.teleop.chromium import browser, needs_browser

EVIL = "</script><script>document.title='evil'</script>"
PLACE = "(({left, top, width, height}) => [left, top, width, height])($('plot').getBoundingClientRect())"
MEDIAN = "((all) => (all[5] + all[6]) / 2)(rows.map((row) => at(row, 'return')).sort((a, b) => a - b))"
NOT_FOUND = "Open the address that was printed"


@pytest.fixture
def server(dataset: Path) -> Iterator[BrowseServer]:
    with BrowseServer(str(dataset), 0) as served:
        thread = threading.Thread(target=served.serve_forever, daemon=True)
        thread.start()
        yield served
        served.shutdown()
        thread.join()


def ask(
    server: LocalServer, path: str, body: object = None, *, token: str | None = None, **headers: str
) -> tuple[int, str]:
    """Return the status and the text of an answer; a POST where there is a body."""
    connection = HTTPConnection("127.0.0.1", server.server_port)
    text = None if body is None else body if isinstance(body, str) else json.dumps(body)
    address = f"{path}?token={server.token if token is None else token}"
    connection.request("GET" if body is None else "POST", address, body=text, headers=headers)
    answer = connection.getresponse()
    assert all(answer.headers[name] == value for name, value in HEADERS.items())
    return answer.status, answer.read().decode(errors="replace")


def test_the_file_opens_offline_and_believes_no_label(dataset: Path, tmp_path: Path) -> None:
    assert main(["relabel", str(dataset), "where=seed == 3", f"tag={EVIL}", QUIET]) == 0
    assert main(["browse", str(dataset), f"out={tmp_path / 'page.html'}", QUIET]) == 0
    html = (tmp_path / "page.html").read_text()
    assert needs_nothing_else(html)
    assert EVIL not in html
    assert html.count("<script") == 2


def test_the_server_lets_in_who_knows_the_token(server: BrowseServer) -> None:
    assert ask(server, "/")[0] == 200
    port = server.server_port
    for asked in (
        ask(server, "/", token="guessed"),
        ask(server, "/", token=""),
        ask(server, "/other"),
        ask(server, "/", Host=f"evil.example:{port}"),
        ask(server, "/edit", {"what": "undo"}, token="guessed"),
        ask(server, "/edit", {"what": "undo"}, Origin="http://evil.example"),
        ask(server, "/film", {"uid": "x"}, Host="127.0.0.1"),
    ):
        assert asked[0] == 403
        assert NOT_FOUND in asked[1]


def test_edits_of_the_page_are_those_of_the_commands(server: BrowseServer, dataset: Path) -> None:
    before, uids = digests(dataset), open_dataset(dataset, failures=True).uids
    status, text = ask(server, "/edit", {"what": "relabel", "uids": uids[:2], "labels": {"tag": "seen"}})
    assert (status, json.loads(text)["said"]) == (200, "2 episodes are relabelled.")
    status, text = ask(server, "/edit", {"what": "delete", "uids": uids})
    assert (status, json.loads(text)["rows"]) == (200, [])
    assert ask(server, "/")[0] == 200, "an empty table is shown, too"
    for _ in range(2):
        assert ask(server, "/edit", {"what": "undo"})[0] == 200
    assert digests(dataset) == before


@pytest.mark.parametrize(
    "asked",
    [
        {"what": "explode", "uids": ["x"]},
        {"what": "delete", "uids": ["../../x"]},
        {"what": "delete", "uids": []},
        {"what": "relabel", "uids": "first", "labels": {"seed": 1}},
        {"what": "relabel", "uids": "first", "labels": {}},
        {"what": "relabel", "uids": "first", "labels": {"success": "perhaps"}},
        {"what": "delete", "uids": 3},
        {"other": 1},
        [1],
        "{",
        "[" * 5000,
    ],
)
def test_bad_questions_are_answered_and_change_nothing(asked: object, server: BrowseServer, dataset: Path) -> None:
    before = digests(dataset)
    if isinstance(asked, dict) and asked.get("uids") == "first":
        asked = {**asked, "uids": [open_dataset(dataset)[0].uid]}
    for path in ("/edit", "/film"):
        assert ask(server, path, asked)[0] == 400
    assert digests(dataset) == before
    assert not (dataset / "trash").exists()


@pytest.mark.render
def test_a_film_is_made_when_it_is_asked_for(tmp_path: Path) -> None:
    words = ["robot=quad", "task=hover", "horizon=10", "episodes=1", f"out={tmp_path / 'hover'}"]
    assert main(["collect", *words, QUIET]) == 0
    with BrowseServer(str(tmp_path / "hover"), 0) as served:
        uid = open_dataset(tmp_path / "hover", failures=True).uids[0]
        assert served.film(uid)[4:8] == b"ftyp"


@pytest.mark.slow
@pytest.mark.browser
@needs_browser
def test_the_file_writes_the_command_for_what_is_marked(dataset: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    assert main(["browse", str(dataset), f"out={page}", QUIET]) == 0
    html = dom_after(
        page, "$('find').value = 'crash'; $('find').oninput(); $('mark').onclick(); $('delete').onclick();"
    )
    command = re.search(r'<pre id="command">aerial-il (.*?)</pre>', html, re.DOTALL)
    assert command is not None
    crashed = [e for e in open_dataset(dataset, failures=True) if e.terminated[-1] and not e.success]
    assert main([*shlex.split(unescape(command[1])), QUIET]) == 0
    assert len(open_dataset(dataset, failures=True)) == 12 - len(crashed) < 12


@pytest.mark.slow
@pytest.mark.browser
@needs_browser
def test_a_brush_chooses_and_a_button_deletes(server: BrowseServer, dataset: Path) -> None:
    async def flow() -> list[str]:
        async with browser() as open_page:
            tab = await open_page(server.url)
            await tab.look(width=1200, height=1400)
            await tab.until("document.querySelectorAll('#body tr').length === 12")
            left, top, width, height = await tab.value(PLACE)
            middle = await tab.value("$('plot').getBoundingClientRect().top + places().py(" + MEDIAN + ")")
            drag = [("mousePressed", left + 45, middle), ("mouseMoved", left + width - 5, top + height - 10)]
            for kind, x, y in (*drag, ("mouseReleased", left + width - 5, top + height - 10)):
                await tab.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)
            await tab.until("brush !== null")
            await tab.value("$('mark').click()")
            shown = await tab.value("$('counts').textContent + '; ' + marked.size")
            await tab.value("$('delete').click()")
            await tab.until("$('said').textContent.includes('in the trash')")
            return [shown, *tab.errors]

    shown, *errors = asyncio.run(flow())
    returns = [episode.total_reward for episode in open_dataset(dataset, failures=True)]
    assert not errors
    gone = int(shown.rpartition("; ")[2])
    assert gone == 6
    assert "; 6 shown" in shown
    assert len(returns) == 12 - gone
    assert len([*(dataset / "trash").rglob("*.mcap")]) == gone
