"""The report is one well-formed file that needs nothing else, tells the numbers and hides no failure."""

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from aerial_il.core.errors import InvalidValueError
from aerial_il.evaluation.curves import DatasetSummary, LearningPoint, curves_of, read_rows
from aerial_il.evaluation.result import EvaluationResult, load_result
from aerial_il.presentation.films.video import Clip, Footage
from aerial_il.presentation.pages.page import percent, seconds
from aerial_il.presentation.pages.report import write_report
from tests.presentation.browser import needs_browser, picture
from tests.presentation.outline import Outline, needs_nothing_else


@dataclass(frozen=True)
class Full:
    """A report with every section, and what went into it."""

    html: str
    path: Path


@pytest.fixture(scope="module")
def full(diver: EvaluationResult, expert: EvaluationResult, tmp_path_factory: pytest.TempPathFactory) -> Full:
    folder = tmp_path_factory.mktemp("report")
    rows = [{"step": k, "train/loss": 1 / (k + 1), "lr": 1e-3} for k in range(0, 2000, 2)]
    (folder / "metrics.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    film = folder / "film.mp4"
    film.write_bytes(b"not really a film")
    path = write_report(
        folder / "report.html",
        diver,
        footage=Footage((Clip(film, diver.episodes[0]),)),
        run=folder,
        dataset=DatasetSummary("datasets/demo", 100, 98, 12345, 246.9, (0, 101)),
        learning_curve=[LearningPoint(100, expert), LearningPoint(10, diver)],
        command="aerial-il evaluate policy=diver",
    )
    return Full(path.read_text(encoding="utf-8"), path)


def test_the_file_needs_nothing_else(full: Full) -> None:
    assert needs_nothing_else(full.html)
    assert not {"link", "iframe", "object", "img"} & set(Outline(full.html).tags)


def test_every_section_is_there_once(full: Full) -> None:
    ids = [name for name in Outline(full.html).ids if not name.startswith(("film-", "failure-"))]
    assert ids == [
        *("episodes", "subtasks", "films", "failures", "numbers", "spread", "paths"),
        *("demonstrations", "training", "curve", "origin"),
    ]
    for name in ids:
        assert f'aria-labelledby="{name}"' in full.html


def test_the_headline_has_its_interval(full: Full, diver: EvaluationResult) -> None:
    lo, hi = diver.success["ci95"]
    assert f"<b>{diver.success['count']} of 40</b>" in full.html
    assert percent(lo) in full.html
    assert percent(hi) in full.html
    assert "Bring the hook to the ball." in full.html


def test_every_seed_and_every_failure_is_listed(full: Full, diver: EvaluationResult) -> None:
    assert re.findall(r'title="seed (\d+): [a-z ]+ after', full.html) == [str(seed) for seed in diver.seeds]
    failed = [e for e in diver.episodes if not e.success]
    table = full.html.split('id="failures"')[1].split("</table>")[0]
    assert re.findall(r'<tr id="failure-(\d+)">', table) == [str(e.seed) for e in failed]


def test_squares_and_failures_lead_to_what_is_shown_of_them(full: Full, diver: EvaluationResult) -> None:
    ids, filmed = set(Outline(full.html).ids), diver.episodes[0].seed
    led = re.findall(r'<a href="#([a-z]+-\d+)" aria-label="seed (\d+):', full.html)
    assert {int(seed) for _, seed in led} == {e.seed for e in diver.episodes if not e.success} | {filmed}
    assert all(place in ids and place.endswith(f"-{seed}") for place, seed in led)
    assert (f"film-{filmed}", str(filmed)) in led


def test_a_bare_report_leaves_out_what_was_not_given(diver: EvaluationResult, tmp_path: Path) -> None:
    html = write_report(tmp_path / "r.html", diver).read_text()
    assert not {"films", "demonstrations", "training", "curve"} & set(Outline(html).ids)
    html = write_report(tmp_path / "r.html", diver, footage=Footage(note="No video: nothing renders.")).read_text()
    assert "No video: nothing renders." in html


def test_a_report_from_disk_has_its_paths(diver: EvaluationResult, full: Full, tmp_path: Path) -> None:
    html = write_report(tmp_path / "report.html", load_result(diver.save(tmp_path))).read_text()
    drawn = html.split('id="paths"')[1].split("</section>")[0]
    assert drawn.count("<polyline") == 2 * 40


def test_a_report_of_nothing_but_crashes_still_reads(diver: EvaluationResult, tmp_path: Path) -> None:
    crashes = tuple(e for e in diver.episodes if e.end == "crash")
    html = write_report(tmp_path / "r.html", replace(diver, episodes=crashes, flights={})).read_text()
    assert f"<b>0 of {len(crashes)}</b>" in html
    assert "<dt>Median time to success</dt><dd>–</dd>" in html


def test_names_from_outside_are_escaped(diver: EvaluationResult, tmp_path: Path) -> None:
    sly = replace(diver, policy="<script>alert(1)</script>", provenance={"note": "<img src=x>"})
    html = write_report(tmp_path / "r.html", sly, command="<b>").read_text()
    assert "img" not in Outline(html).tags
    assert Outline(html).tags.count("script") == 1  # the page's own
    assert "&lt;script&gt;" in html


def test_only_exact_rates_read_as_none_or_all() -> None:
    assert [percent(r) for r in (0.0, 1.0, 0.975, 0.9999, None)] == ["0", "100", "97.5", "100.0", "–"]
    assert [seconds(t) for t in (0.48, 12.34, None)] == ["0.48 s", "12.3 s", "–"]


def test_training_curves_survive_a_killed_writer(tmp_path: Path) -> None:
    metrics = tmp_path / "metrics.jsonl"
    metrics.write_text('{"step": 0, "loss": 1.0}\n{"step": 10, "loss": 0.5}\n{"step": 20, "lo')
    (curve,) = curves_of(read_rows(tmp_path / "metrics.jsonl"))
    assert (curve.name, curve.steps.tolist(), curve.values.tolist()) == ("loss", [0, 10], [1.0, 0.5])
    metrics.write_text('{"step": 0, "loss": 1.0}\n{"loss": 1.0}\n')
    with pytest.raises(InvalidValueError, match=r"metrics\.jsonl, line 2: not a row"):
        curves_of(read_rows(tmp_path / "metrics.jsonl"))
    with pytest.raises(InvalidValueError, match=r"cannot be read .* training run"):
        curves_of(read_rows(tmp_path / "missing" / "metrics.jsonl"))


def test_a_long_curve_begins_and_ends_as_it_was_logged() -> None:
    (curve,) = curves_of({"step": 100 * k, "loss": float(1000 - k)} for k in range(1000))
    assert (len(curve.steps), len(curve.values)) == (300, 300)
    assert (curve.steps[0], curve.steps[-1], curve.values[0], curve.values[-1]) == (0, 99_900, 1000.0, 1.0)
    assert (np.diff(curve.steps) > 0).all()
    assert (np.diff(curve.values) < 0).all()


@pytest.mark.browser
@needs_browser
def test_a_browser_draws_it_in_light_and_dark(full: Full, tmp_path: Path) -> None:
    light = picture(full.path, tmp_path / "light.png")
    dark = picture(full.path, tmp_path / "dark.png", dark=True)
    assert light.mean() > 200
    assert dark.mean() < 60
    assert light.std() > 10
