"""A real browser: charts tell the value under the cursor, zoom into what is dragged over, and obey the keyboard."""

import html
import json
import re
from pathlib import Path

import numpy as np
import pytest

from aerial_il.evaluation.curves import Curve
from aerial_il.presentation.pages.figures import logged
from aerial_il.presentation.pages.page import TEMPLATES
from tests.presentation.browser import dom_after, needs_browser

pytestmark = [pytest.mark.browser, needs_browser]
POINTER = """
const chart = document.querySelector(".chart"), seen = {};
const [x0, y0, width, height] = chart.querySelector(".data").getAttribute("viewBox").split(" ").map(Number);
const at = (kind, x, y) => {
  const p = new DOMPoint(x0 + x * width, y0 + y * height).matrixTransform(chart.getScreenCTM());
  chart.dispatchEvent(new PointerEvent(kind, { clientX: p.x, clientY: p.y, pointerId: 1, bubbles: true }));
};
const press = key => chart.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
const told = () => document.querySelector("output").textContent;
const labels = () => [...chart.querySelectorAll(".ticks text[text-anchor=middle]")].map(t => +t.textContent);
chart.setPointerCapture = () => {};
"""
END = "document.body.dataset.seen = JSON.stringify(seen);"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of one curve, y = x / 2 over 0 to 100."""
    steps = np.arange(0.0, 101.0)
    figure = logged(Curve("half", steps, steps / 2), "step")
    path = tmp_path_factory.mktemp("script") / "page.html"
    script = (TEMPLATES / "charts.js").read_text()
    body = f"<figure style='width:400px'><figcaption>half</figcaption>{figure.svg}</figure><script>{script}</script>"
    path.write_text(f"<!doctype html><html><body>{body}</body></html>")
    return path


def seen(page: Path, script: str) -> dict[str, object]:
    dom = dom_after(page, POINTER + script + END)
    written = re.search(r'data-seen="([^"]*)"', dom)
    assert written, dom[-500:]
    return json.loads(html.unescape(written[1]))


def test_the_value_under_the_cursor_is_shown(page: Path) -> None:
    told = seen(page, 'at("pointermove", 0.3, 0.1); seen.there = told(); at("pointerleave", 0, 0); seen.gone = told();')
    assert told == {"there": "step = 30 · 15", "gone": ""}


def test_dragging_zooms_and_a_double_click_shows_all(page: Path) -> None:
    told = seen(
        page,
        """seen.before = labels();
        at("pointerdown", 0.4, 0.5); at("pointermove", 0.6, 0.5); at("pointerup", 0.6, 0.5);
        seen.zoomed = labels(); seen.clipped = chart.classList.contains("zoomed");
        at("pointermove", 0.5, 0.5); seen.there = told();
        chart.dispatchEvent(new MouseEvent("dblclick", { bubbles: true })); seen.after = labels();""",
    )
    assert told["before"] == told["after"] == [0, 20, 40, 60, 80, 100]
    assert told["zoomed"] == [40, 45, 50, 55, 60]
    assert (told["clipped"], told["there"]) == (True, "step = 50 · 25")


def test_a_click_is_no_drag(page: Path) -> None:
    told = seen(page, 'at("pointerdown", 0.4, 0.5); at("pointerup", 0.4, 0.5); seen.labels = labels();')
    assert told["labels"] == [0, 20, 40, 60, 80, 100]


def test_the_keyboard_steps_zooms_and_resets(page: Path) -> None:
    told = seen(
        page,
        """seen.focus = chart.tabIndex;
        press("ArrowRight"); seen.first = told(); press("ArrowRight"); seen.second = told();
        press("ArrowLeft"); seen.back = told(); press("+"); seen.zoomed = labels();
        press("Escape"); seen.all = labels();""",
    )
    assert (told["first"], told["second"], told["back"]) == ("step = 0 · 0", "step = 1 · 0.5", "step = 0 · 0")
    assert told["focus"] == 0
    assert told["zoomed"] == [0, 10, 20, 30, 40, 50]
    assert told["all"] == [0, 20, 40, 60, 80, 100]
