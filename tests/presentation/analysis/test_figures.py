"""The figures show the numbers of their files, and say what they lack."""

import io
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.container import BarContainer, ErrorbarContainer
from matplotlib.figure import Figure

from aerial_il.core.errors import InvalidValueError
from aerial_il.evaluation.statistics import wilson
from aerial_il.presentation import analysis
from tests.presentation.analysis.test_frames import evaluated
from tests.presentation.pages.test_run_report import RATES, make_adversarial, make_dagger, make_run


def axes_of(figure: Figure) -> list[Axes]:
    """Return a figure's axes, which are labelled, once it was drawn."""
    figure.savefig(file := io.BytesIO(), format="png")
    assert file.getvalue().startswith(b"\x89PNG")
    assert all(axes.get_xlabel() for axes in figure.axes)
    return figure.axes


def test_success_stands_at_its_rate_between_the_ends_of_wilson() -> None:
    (axes,) = axes_of(analysis.success({"one": evaluated([True] * 3 + [False]), "two": evaluated([False] * 4)}))
    bars = [one for one in axes.containers if isinstance(one, ErrorbarContainer)]
    assert [np.asarray(one.lines[0].get_xdata())[0] for one in bars] == [75.0, 0.0]
    ends = np.array(bars[0].lines[2][0].get_segments()[0])[:, 0]
    assert ends == pytest.approx([100 * end for end in wilson(3, 4)])
    assert axes.get_yticklabels()[0].get_text() == "one\n3 of 4 flights"


def test_learning_curves_show_each_run_and_their_mean(tmp_path: Path) -> None:
    runs = [make_run(tmp_path / "0"), make_run(tmp_path / "1", seed=1, rates=tuple(r / 2 for r in RATES))]
    (axes,) = axes_of(analysis.learning_curves({"both": runs, "one": runs[:1]}))
    drawn = [np.asarray(line.get_ydata()) for line in axes.lines]
    assert np.allclose(drawn, [[100 * f * r for r in RATES] for f in (1, 0.5, 0.75, 1)])
    with pytest.raises(InvalidValueError, match="evaluate_every"):
        analysis.learning_curves({"blind": [make_run(tmp_path / "2", rates=())]})


def test_any_number_of_any_run_is_drawn_over_any_other(tmp_path: Path) -> None:
    dac = [make_adversarial(tmp_path / "0"), make_adversarial(tmp_path / "1", seed=1, rewards=(0.5, 1.5))]
    (axes,) = axes_of(analysis.curves({"dac": dac}))
    one, other, mean = (np.asarray(line.get_xydata()) for line in axes.lines)
    assert np.allclose(one, [[5000, 1], [10000, 1 / 2], [15000, 1 / 3]])
    assert np.allclose(other, one[:2])
    assert np.allclose(mean, one[:2]), "drawn where both have values"
    (axes,) = axes_of(analysis.curves({"dac": dac[:1]}, "evaluate/mean_reward"))
    assert list(np.asarray(axes.lines[0].get_ydata())) == [0.5, 1.5, 3.0]
    (axes,) = axes_of(analysis.curves({"dagger": [make_dagger(tmp_path / "2")]}, "beta", over="total/queries"))
    assert (axes.get_xlabel(), list(np.asarray(axes.lines[0].get_xdata()))) == ("total/queries", [1, 2, 3, 4])
    with pytest.raises(InvalidValueError, match=r"it logged .*beta"):
        analysis.curves({"dagger": [tmp_path / "2"]}, "episode/return")
    (tmp_path / "1" / "metrics.jsonl").write_text('{"step": 90000, "episode/return": 1}\n')
    with pytest.raises(InvalidValueError, match="no common stretch"):
        analysis.curves({"dac": dac})


def test_returns_show_every_flight_and_survival_successes() -> None:
    result = evaluated([True, False, True, False])
    (axes,) = axes_of(analysis.returns({"p": result}))
    assert sorted(np.asarray(axes.lines[0].get_ydata())) == [30.0, 30.0, 40.0, 42.0]
    (axes,) = axes_of(analysis.survival({"p": result}))
    assert list(np.asarray(axes.lines[0].get_ydata())) == [0, 25, 50, 50]
    assert list(np.asarray(axes.lines[0].get_xdata())) == [0, 1, 3, 3]


def test_a_paired_comparison_counts_seeds_and_refuses_others() -> None:
    a, b = evaluated([True, True, False, False]), evaluated([True, False, True, True])
    counts, difference = axes_of(analysis.paired_comparison(a, b))
    bars = [one for one in counts.containers if isinstance(one, BarContainer)]
    assert [bar.get_width() for bar in bars[0]] == [1, 1, 2, 0]
    assert "p = 1" in difference.get_title()
    with pytest.raises(InvalidValueError, match="same seeds"):
        analysis.paired_comparison(a, evaluated([True] * 4, first=20000))


def test_nothing_to_draw_is_said() -> None:
    for figure in (analysis.success, analysis.returns, analysis.survival, analysis.learning_curves, analysis.curves):
        with pytest.raises(InvalidValueError, match="nothing to draw"):
            figure({})
