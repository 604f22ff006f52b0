"""The card of a dataset: what its page and its README say, and whom they do not believe."""

import asyncio
import re
import shutil
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
import yaml

from aerial_il.cli.main import main
from aerial_il.core.errors import DemoError
from aerial_il.data.coverage import Coverage
from aerial_il.data.dataset import open_dataset
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.summary import Summary, summarise
from aerial_il.presentation.pages.card import action_strips, by, origin, phases
from aerial_il.presentation.pages.charts import FEW, density, strip
from aerial_il.workflows.card import Card, card
from tests.curation.conftest import QUIET, Recorded
from tests.presentation.browser import needs_browser
from tests.presentation.outline import needs_nothing_else
from tests.teleop.chromium import browser

EVIL = "</td><script>document.title='evil'</script>"
NO_FILMS = "films=0"


@pytest.fixture(scope="module")
def many(cranes: Recorded) -> Path:
    """Flights of which at least eight succeed, so that they are judged."""
    return cranes(100, 24, "expert")


def summary_of(path: Path, *, failures: bool = True) -> Summary:
    return summarise(open_dataset(path, failures=failures, states=False))


def test_the_page_opens_offline_and_believes_no_label(dataset: Path, tmp_path: Path) -> None:
    for key in ("tag", "operator", "instruction"):
        assert main(["relabel", str(dataset), "where=seed in [3, 5]", f"{key}={EVIL}{key}", QUIET]) == 0
    page, readme = tmp_path / "page.html", tmp_path / "read.md"
    assert main(["card", str(dataset), f"out={page}", f"readme={readme}", NO_FILMS, QUIET]) == 0
    html = page.read_text()
    assert needs_nothing_else(html)
    assert "<script" not in html
    assert f"{EVIL}tag" in unescape(html)
    assert f"{EVIL}operator" in unescape(html)
    assert "<script" not in readme.read_text()


def test_a_hostile_name_of_the_dataset_is_text(dataset: Path, tmp_path: Path) -> None:
    named = dataset.rename(tmp_path / "\"'><script>x<b>")
    assert main(["card", str(named), NO_FILMS, QUIET]) == 0
    html = (named / "card.html").read_text()
    assert needs_nothing_else(html)
    assert "<script" not in html
    assert "<b>x" not in html


def test_counts_are_those_of_the_episodes(dataset: Path) -> None:
    made = card(Card(path=str(dataset), films=0, progress=False))
    episodes = list(open_dataset(dataset, failures=True))
    html, won = made.page.read_text(), sum(e.success for e in episodes)
    assert f'<dt>Successes</dt><dd class="badge won">{won}</dd>' in html
    assert f'<dt>Failures</dt><dd class="badge lost">{len(episodes) - won}</dd>' in html
    assert f"{sum(map(len, episodes)):,} <small>at 50.0 Hz" in html
    assert sum(map(int, re.findall(r"<title>[^<]*: (\d+) (?:success|failure)</title>", html))) == len(episodes)


def test_success_is_counted_by_tag_with_its_interval(dataset: Path) -> None:
    assert main(["relabel", str(dataset), "where=not success", "tag=bad", QUIET]) == 0
    rows = summary_of(dataset).rows
    lines = {line.name: line for line in by(rows, "tag")}
    assert lines["bad"].rate == 0.0
    assert lines["–"].rate == 1.0
    assert lines["bad"].interval is not None
    assert lines["bad"].interval[1] > 0.1
    assert lines["bad"].count + lines["–"].count == len(rows)


def test_coverage_is_that_of_all_steps(many: Path) -> None:
    coverage, episodes = summary_of(many).coverage, list(open_dataset(many, failures=True))
    actions = np.concatenate([e.executed_actions for e in episodes])
    states = np.concatenate([e.flat_obs(e.spec.observation.state_names)[:-1] for e in episodes])
    np.testing.assert_array_equal(coverage.high, [*states.max(0), *actions.max(0)])
    np.testing.assert_array_equal(coverage.low, [*states.min(0), *actions.min(0)])
    share = ((actions[:, 1] < -0.5 + 2.5e-3) | (actions[:, 1] > 2.0 - 2.5e-3)).mean()
    row = action_strips(coverage)[1]
    assert row.at_bound == pytest.approx(share)
    assert 0 < share < 1, "where goals are out of reach, it pulls as high as it may"
    assert row.used == pytest.approx(np.ptp(np.quantile(actions[:, 1], (0.01, 0.99))) / 2.5, abs=0.02)
    assert sum(line.share for line in phases(coverage)) == pytest.approx(1.0)


@pytest.mark.parametrize("bounds", [(-np.inf, np.inf), (0.999999, 1.000001)])
def test_bounds_may_be_far_or_close(bounds: tuple[float, float], dataset: Path) -> None:
    flown = open_dataset(dataset)[0]
    low, high = (np.full(2, end) for end in bounds)
    spec = replace(flown.spec, action=replace(flown.spec.action, low=low, high=high))
    coverage = Coverage.of(replace(flown, spec=spec), 1)
    assert coverage.add(replace(flown, spec=spec, executed_actions=np.full_like(flown.executed_actions, 1.0)))
    row = action_strips(coverage)[0]
    assert row.seen == (1.0, 1.0)
    assert row.used == (0.0 if np.isfinite(low[0]) else None)
    assert row.svg.count("<rect") == 1


def test_what_one_episode_says_is_not_said_of_all(dataset: Path) -> None:
    flown = open_dataset(dataset)[0]
    coverage = Coverage.of(flown, 30)
    for number in range(30):
        mine = {"task": "reach", "noise": 0.01 * number, **({"note": "corrected"} if number == 7 else {})}
        coverage.add(replace(flown, provenance=mine))
    said = dict(origin(coverage))
    assert said["task"] == "reach"
    assert said["note"] == "corrected (1)"
    assert said["noise"].startswith("others (18), 0.0 (1), ")


def test_verdicts_are_those_that_were_kept(many: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(many, tmp_path / "judged"))
    anew = summary_of(folder)
    assert main(["judge", str(folder), QUIET]) == 0
    kept = summary_of(folder)
    assert anew.judged != kept.judged
    assert [row["uid"] for row in anew.outliers] == [row["uid"] for row in kept.outliers]
    assert len(kept.outliers) == len(open_dataset(folder)), "all demonstrations, and no failure"
    demo = DatasetFolder(folder).files()[0].stem
    for file in (folder / "columns").glob("*.json"):
        file.write_text(file.read_text().replace(demo, "gone"))
    assert "1 demonstrations have no verdict" in summary_of(folder).judged


def test_a_damaged_episode_is_left_out_and_said(dataset: Path) -> None:
    file = DatasetFolder(dataset).files()[0]
    file.write_bytes(file.read_bytes()[:2000])
    made = card(Card(path=str(dataset), films=0, progress=False))
    assert "1 more could not be read" in made.page.read_text()
    for each in dataset.glob("*/*.mcap"):
        each.write_bytes(b"nothing")
    with pytest.raises(DemoError):
        card(Card(path=str(dataset), films=0, progress=False))


def test_a_dataset_without_a_success_has_a_card(dataset: Path) -> None:
    assert main(["relabel", str(dataset), "where=success", "success=false", QUIET]) == 0
    html = card(Card(path=str(dataset), progress=False)).page.read_text()
    assert "0 episodes are too few to say which are unusual" in html
    assert "<video" not in html


def test_what_no_file_says_is_said_to_be_assumed(many: Path, tmp_path: Path) -> None:
    flat = tmp_path / "flat.hdf5"
    assert main(["convert", str(many), "format=d4rl", f"out={flat}", QUIET]) == 0
    assert main(["card", str(flat), QUIET]) == 0
    assert "Taken for granted: a control period" in (tmp_path / "flat-card.html").read_text()


@pytest.mark.parametrize("make", ["missing", "empty", "text"])
def test_what_is_no_dataset_is_refused(make: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = tmp_path / make
    if make == "empty":
        place.mkdir()
    if make == "text":
        place.write_text("words")
    assert main(["card", str(place), QUIET]) == 2
    said = capsys.readouterr().err
    assert str(place) in said
    assert "Traceback" not in said
    assert not [*tmp_path.glob("**/*.html")]


def test_a_lerobot_dataset_gets_the_readme_of_a_hub(dataset: Path, tmp_path: Path) -> None:
    derived = tmp_path / "lerobot"
    assert main(["convert", str(dataset), f"out={derived}", QUIET]) == 0
    assert main(["card", str(derived), "license=mit", QUIET]) == 0
    readme = derived / "README.md"
    front = yaml.safe_load(readme.read_text().split("---")[1])
    assert front["license"] == "mit"
    assert front["task_categories"] == ["robotics"]
    assert "LeRobot" in front["tags"]
    assert (
        "keeps no scene" in (derived / "card.html").read_text() or "are too few" in (derived / "card.html").read_text()
    )
    assert main(["card", str(derived), QUIET]) == 0
    assert "\nlicense: mit\n" in readme.read_text(), "what was said of it stays"
    assert main(["convert", str(dataset), f"out={derived}", QUIET]) == 0, "a card of ours is in nobody's way"
    readme.write_text("My words about aerial_il.\n")
    assert main(["card", str(derived), QUIET]) == 0
    assert readme.read_text() == "My words about aerial_il.\n"
    assert main(["card", str(derived), f"readme={readme}", QUIET]) == 2


def test_films_need_states_and_a_scene(many: Path, tmp_path: Path) -> None:
    derived = tmp_path / "lerobot"
    assert main(["convert", str(many), f"out={derived}", QUIET]) == 0
    html = card(Card(path=str(derived), progress=False)).page.read_text()
    assert "No films: " in html
    assert "<video" not in html


def test_a_density_counts_every_point_once() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(FEW + 1, 2))
    drawn = density("places", points, x_label="x", y_label="y").svg
    assert sum(map(int, re.findall(r"<title>(\d+)</title>", drawn))) == FEW + 1
    few = density("places", points[:FEW], x_label="x", y_label="y", crosses=points[:3]).svg
    assert few.count("<circle") == FEW
    assert few.count("failure") == 3
    assert density("one", points[:1], x_label="x", y_label="y").svg.count("<circle") == 1
    assert strip(points[:, 0], -9.0, 9.0, alt='"<').count("<rect") > 5


@pytest.mark.render
def test_outliers_play(tmp_path: Path) -> None:
    flown = ["robot=quad", "task=hover", "horizon=10", "episodes=9", f"out={tmp_path / 'hover'}"]
    assert main(["collect", *flown, QUIET]) == 0
    assert main(["relabel", str(tmp_path / "hover"), "where=not success", "success=true", QUIET]) in (0, 2)
    assert main(["card", str(tmp_path / "hover"), "films=2", QUIET]) == 0
    html = (tmp_path / "hover" / "card.html").read_text()
    assert html.count("data:video/mp4") == 2
    assert needs_nothing_else(html)


@pytest.mark.slow
@pytest.mark.browser
@needs_browser
def test_nothing_of_the_page_runs_out_of_the_window(many: Path, tmp_path: Path) -> None:
    page = tmp_path / "card.html"
    assert main(["card", str(many), f"out={page}", NO_FILMS, QUIET]) == 0

    async def measured(width: int) -> tuple[float, list[str]]:
        async with browser() as open_page:
            tab = await open_page(page.as_uri())
            await tab.look(width=width, height=1000)
            await tab.until("document.querySelectorAll('svg.strip').length > 10")
            across = await tab.value("document.documentElement.scrollWidth")
            return across, tab.errors

    for width in (1200, 400):
        across, errors = asyncio.run(measured(width))
        assert across <= width
        assert not errors


def test_a_page_is_called_one(many: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["card", str(many), f"out={tmp_path / 'card.txt'}", NO_FILMS, QUIET]) == 2
    assert "let its name end in .html" in capsys.readouterr().err
    assert not (tmp_path / "card.txt").exists()
