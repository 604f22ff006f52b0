"""Small charts as inline SVG: they take their colours from the page, so one drawing serves light and dark.

Every chart is drawn about as wide as the column it stands in, so that its text is as large as the page's small print.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup, escape

NARROW, WIDE, HEIGHT = 320.0, 440.0, 210.0
LEFT, RIGHT, TOP, BOTTOM = 44.0, 12.0, 10.0, 36.0
TALLEST = 420.0
CELLS, STRIPES = (8, 32), 48  # of a density across, at least and at most; of a strip
FEW = 200  # points, which are drawn one by one


@dataclass(frozen=True)
class Figure:
    """A chart with its title and an optional sentence below it."""

    title: str
    svg: Markup
    note: str = ""


@dataclass(frozen=True)
class Scale:
    """Maps data in [lo, hi] to pixels, linearly or by logarithm."""

    lo: float
    hi: float
    start: float
    end: float
    log: bool = False

    def __call__(self, value: float) -> float:
        lo, hi, value = (math.log(v) for v in (self.lo, self.hi, value)) if self.log else (self.lo, self.hi, value)
        return self.start + (value - lo) / (hi - lo) * (self.end - self.start)

    @property
    def of_page(self) -> tuple[float, float, bool]:
        """Its range and whether it is logarithmic, as the page's script needs them."""
        return float(self.lo), float(self.hi), self.log

    def ticks(self) -> list[float]:
        """About five round values, or powers of ten for a logarithm that spans some."""
        if not self.log:
            return round_ticks(self.lo, self.hi)
        powers = range(math.ceil(math.log10(self.lo) - 1e-9), math.floor(math.log10(self.hi) + 1e-9) + 1)
        return [10.0**p for p in powers] if len(powers) > 1 else [self.lo, self.hi]


class Plot:
    """Axes that collect SVG elements.

    Args:
        x, y: data ranges (lo, hi).
        x_label, y_label: axis titles with units.
        alt: what the chart shows, for readers who cannot see it.
        width, height: of the drawing in pixels.
        log_x, log_y: logarithmic axes.
        x_ticks: tick values, instead of round ones.
        percent: label y as percentages.
    """

    def __init__(
        self,
        *,
        x: tuple[float, float],
        y: tuple[float, float],
        x_label: str,
        y_label: str,
        alt: str,
        width: float = NARROW,
        height: float = HEIGHT,
        log_x: bool = False,
        log_y: bool = False,
        x_ticks: Sequence[float] | None = None,
        percent: bool = False,
    ) -> None:
        self.x = Scale(*widen(*x, log=log_x), LEFT, width - RIGHT, log_x)
        self.y = Scale(*widen(*y, log=log_y), height - BOTTOM, TOP, log_y)
        self.width, self.height, self.alt = width, height, alt
        ranges = {"x": self.x.of_page, "y": self.y.of_page}
        self._axes = json.dumps({**ranges, "labels": [x_label, y_label], "percent": percent})
        self._ticks = self._draw_ticks(x_ticks or self.x.ticks(), percent)
        self._frame = self._draw_axes(x_label, y_label)
        self._parts: list[str] = []

    def _draw_ticks(self, x_ticks: Sequence[float], percent: bool) -> list[str]:
        base, right, parts = self.height - BOTTOM, self.width - RIGHT, []
        for value in self.y.ticks():
            y, label = self.y(value), f"{100 * value:g} %" if percent else tick_label(value)
            parts.append(f'<path class="grid" d="M{LEFT:.1f} {y:.1f}H{right:.1f}"/>')
            parts.append(_text(LEFT - 6, y + 3.5, label, "end"))
        return [*parts, *(_text(self.x(value), base + 14, tick_label(value), "middle") for value in x_ticks)]

    def _draw_axes(self, x_label: str, y_label: str) -> list[str]:
        base, right = self.height - BOTTOM, self.width - RIGHT
        line = f'<path class="axis" d="M{LEFT:.1f} {base:.1f}H{right:.1f}"/>'
        parts = [line, _text((LEFT + right) / 2, self.height - 6, x_label, "middle", "label")]
        if y_label:
            turned = f'transform="translate(10 {(TOP + base) / 2:.1f}) rotate(-90)"'
            parts.append(f'<text class="label" text-anchor="middle" {turned}>{escape(y_label)}</text>')
        return parts

    def line(self, x: Iterable[float], y: Iterable[float], kind: str, *, title: str = "") -> None:
        points = " ".join(f"{self.x(a):.1f},{self.y(b):.1f}" for a, b in zip(x, y, strict=True))
        self._parts.append(f'<polyline class="{kind}" points="{points}">{_title(title)}</polyline>')

    def rule(self, x: float, kind: str) -> None:
        """Draw a vertical line over the whole height."""
        self._parts.append(f'<path class="{kind}" d="M{self.x(x):.1f} {TOP:.1f}V{self.height - BOTTOM:.1f}"/>')

    def dot(self, x: float, y: float, kind: str, *, radius: float = 3, title: str = "") -> None:
        centre = f'cx="{self.x(x):.1f}" cy="{self.y(y):.1f}"'
        self._parts.append(f'<circle class="{kind}" {centre} r="{radius}">{_title(title)}</circle>')

    def cross(self, x: float, y: float, kind: str, *, title: str = "") -> None:
        px, py, r = self.x(x), self.y(y), 3.2
        d = f"M{px - r:.1f} {py - r:.1f}l{2 * r} {2 * r}m0 {-2 * r}l{-2 * r} {2 * r}"
        self._parts.append(f'<path class="{kind}" d="{d}">{_title(title)}</path>')

    def whisker(self, x: float, lo: float, hi: float, kind: str) -> None:
        px = self.x(x)
        ends = "".join(f"M{px - 4:.1f} {self.y(v):.1f}h8" for v in (lo, hi))
        self._parts.append(f'<path class="{kind}" d="M{px:.1f} {self.y(lo):.1f}V{self.y(hi):.1f}{ends}"/>')

    def bar(self, x: tuple[float, float], y: tuple[float, float], kind: str, *, title: str) -> None:
        left, right, top, base = self.x(x[0]) + 0.6, self.x(x[1]) - 0.6, self.y(y[1]), self.y(y[0])
        box = f'x="{left:.1f}" y="{top:.1f}" width="{max(right - left, 0.8):.1f}" height="{base - top:.1f}"'
        self._parts.append(f'<rect class="{kind}" {box} rx="1">{_title(title)}</rect>')

    def cell(self, x: tuple[float, float], y: tuple[float, float], share: float, *, title: str) -> None:
        """Fill a rectangle, with the fuller a colour the larger its ``share`` in (0, 1] of what the fullest has."""
        left, right, top, base = self.x(x[0]), self.x(x[1]), self.y(y[1]), self.y(y[0])
        box = f'x="{left:.1f}" y="{top:.1f}" width="{right - left:.1f}" height="{base - top:.1f}"'
        self._parts.append(f'<rect class="cell" {box} opacity="{shade(share):.2f}">{_title(title)}</rect>')

    def svg(self) -> Markup:
        """Return the drawing: ticks and axes, and the data in a picture of its own, of which a page can show a part."""
        width, height = self.width - LEFT - RIGHT, self.height - TOP - BOTTOM
        head = f'<svg class="chart" viewBox="0 0 {self.width:g} {self.height:g}" role="img" '
        head += f'aria-label="{escape(self.alt)}" data-axes="{escape(self._axes)}"><g class="ticks">'
        place = f'x="{LEFT:g}" y="{TOP:g}" width="{width:g}" height="{height:g}"'
        inner = f'<svg class="data" {place} viewBox="{LEFT:g} {TOP:g} {width:g} {height:g}" preserveAspectRatio="none">'
        pieces = (head, *self._ticks, "</g>", *self._frame, inner, *self._parts, "</svg></svg>")
        return Markup("".join(pieces))  # every text in it went through escape()


def histogram(title: str, groups: Mapping[str, Sequence[float]], *, x_label: str, kinds: Mapping[str, str]) -> Figure:
    """Draw the stacked counts of several groups of numbers over common bins.

    Args:
        title: of the figure.
        groups: name -> values; drawn from the bottom up.
        x_label: quantity and unit.
        kinds: name -> CSS class.
    """
    pooled = np.concatenate([np.asarray(values, dtype=float) for values in groups.values()])
    lo, hi = float(pooled.min()), float(pooled.max())
    edges = np.linspace(*widen(lo, hi), _bins(pooled) + 1).tolist()
    tallest = float(np.histogram(pooled, edges)[0].max())
    alt = f"Histogram of {title}: {pooled.size} values from {tick_label(lo)} to {tick_label(hi)}"
    plot = Plot(x=(edges[0], edges[-1]), y=(0, tallest), x_label=x_label, y_label="episodes", alt=alt)
    base = [0] * (len(edges) - 1)
    for name, values in groups.items():
        for k, count in enumerate(np.histogram(values, edges)[0].tolist()):
            if count:
                where = f"{tick_label(edges[k])} to {tick_label(edges[k + 1])}"
                rise = (base[k], base[k] + count)
                plot.bar((edges[k], edges[k + 1]), rise, kinds[name], title=f"{where}: {count} {name}")
                base[k] += count
    return Figure(title, plot.svg())


def density(title: str, points: np.ndarray, *, x_label: str, y_label: str, crosses: np.ndarray | None = None) -> Figure:
    """Draw how many of the points (N, 2) lie where, a metre upwards as long as one sideways.

    Args:
        title: of the figure. points: at least one. x_label, y_label: quantities and units.
        crosses: (K, 2) points that are marked one by one.
    """
    x, y = ((float(values.min()), float(values.max())) for values in points.T)
    height = equal_height(x, y, width=NARROW)
    alt = f"{title}: {len(points)} points within {x_label} {x[0]:.3g} to {x[1]:.3g}, {y_label} {y[0]:.3g} to {y[1]:.3g}"
    plot = Plot(x=x, y=y, x_label=x_label, y_label=y_label, alt=alt, height=height)
    if len(points) <= FEW:
        for across, up in points.tolist():
            plot.dot(across, up, "place", radius=2.5)
    else:
        _fill(plot, points, (x, y), height / NARROW)
    for across, up in [] if crosses is None else crosses.tolist():
        plot.cross(across, up, "end bad", title="failure")
    return Figure(title, plot.svg())


def _fill(plot: Plot, points: np.ndarray, ends: Sequence[tuple[float, float]], aspect: float) -> None:
    """Draw the cells of a density, in which points (N, 2) between two ends lie; ``aspect``: height over width."""
    across = int(np.clip(math.sqrt(len(points)) / 2, *CELLS))
    sides = [np.linspace(*widen(*pair), n + 1) for pair, n in zip(ends, (across, round(across * aspect)), strict=True)]
    counts, _, _ = np.histogram2d(points[:, 0], points[:, 1], bins=sides)
    for i, j in np.argwhere(counts).tolist():
        x, y = ((float(side[k]), float(side[k + 1])) for side, k in zip(sides, (i, j), strict=True))
        plot.cell(x, y, counts[i, j] / counts.max(), title=f"{counts[i, j]:.0f}")


def strip(values: np.ndarray, lo: float, hi: float, *, alt: str) -> Markup:
    """Draw how numbers (N,) lie between two ends as a strip: the more, the fuller its colour; it has no axes."""
    counts, _ = np.histogram(np.clip(values.astype(float), lo, hi), bins=STRIPES, range=widen(lo, hi))
    boxes = "".join(
        f'<rect class="cell" x="{k}" width="1.05" height="1" opacity="{shade(count / counts.max()):.2f}"/>'
        for k, count in enumerate(counts.tolist())
        if count
    )
    head = f'<svg class="strip" viewBox="0 0 {STRIPES} 1" preserveAspectRatio="none" role="img" '
    return Markup(f'{head}aria-label="{escape(alt)}">{boxes}</svg>')


def shade(share: float) -> float:
    """Return the opacity of a cell with a ``share`` in (0, 1] of what the fullest one has; rare ones can be seen."""
    return 0.15 + 0.85 * math.sqrt(share)


def equal_height(x: tuple[float, float], y: tuple[float, float], *, width: float) -> float:
    """Return the drawing height at which a metre is as long upwards as sideways, within limits."""
    (x_lo, x_hi), (y_lo, y_hi) = widen(*x), widen(*y)
    per_unit = (width - LEFT - RIGHT) / (x_hi - x_lo)
    return min(TALLEST, max(120.0, (y_hi - y_lo) * per_unit + TOP + BOTTOM))


def widen(lo: float, hi: float, *, log: bool = False) -> tuple[float, float]:
    """Give a range of no width some."""
    if hi > lo:
        return lo, hi
    if log:
        return lo / 2, lo * 2
    half = abs(lo) * 0.05 or 0.5
    return lo - half, lo + half


def round_ticks(lo: float, hi: float) -> list[float]:
    """Return about five multiples of 1, 2 or 5 times a power of ten within [lo, hi]."""
    raw = (hi - lo) / 5
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= raw * 0.999)
    first, last = math.ceil(lo / step - 1e-9), math.floor(hi / step + 1e-9)
    return [k * step for k in range(first, last + 1)]


def tick_label(value: float) -> str:
    """Return a short number: 0, 0.05, 12.5, 1500, 2e+06."""
    return f"{float(f'{value:.4g}'):.10g}" if 1e-4 <= abs(value) < 1e6 else f"{value:.3g}" if value else "0"


def _bins(values: np.ndarray) -> int:
    return int(np.clip(len(np.histogram_bin_edges(values, "auto")) - 1, 10, 24))


def _text(x: float, y: float, text: str, anchor: str, kind: str = "tick") -> str:
    return f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'


def _title(text: str) -> str:
    return f"<title>{escape(text)}</title>" if text else ""
