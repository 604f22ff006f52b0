"""Pages that open offline: one HTML file each, from a template in ``templates``, in one style for light and dark."""

import base64
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aerial_il.core.composition import dotted
from aerial_il.core.files import write_atomic
from aerial_il.core.places import claim_file
from aerial_il.presentation.pages.charts import tick_label
from aerial_il.teleop.page import PAGE

TEMPLATES = Path(__file__).parent / "templates"
COLOURS = PAGE  # the folder of theme.css, which the page to fly on has too
END_WORDS = {"success": "success", "crash": "crash", "dropped": "dropped", "timeout": "out of time"}
MEDIA_TYPES = {".mp4": "video/mp4", ".jpg": "image/jpeg", ".png": "image/png"}


def write_page(path: str | os.PathLike[str], template: str, **values: Any) -> Path:
    """Fill ``template`` with ``values``, escaping them, and write the page.

    Args:
        path: destination, an HTML file. template: name of a ``.html.j2`` file. values: what it asks for; all of it.
    """
    return write_atomic(claim_file(path), page_text(template, **values))


def page_text(template: str, **values: Any) -> str:
    """Return a page as text; arguments as of :func:`write_page`."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    pages = Environment(
        loader=FileSystemLoader([TEMPLATES, COLOURS]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    pages.filters |= {"number": number, "seconds": seconds, "percent": percent, "words": words, "cell": cell}
    return pages.get_template(template).render(**values)


def data_uri(path: Path) -> str:
    """Return a film or picture as an address that holds all of it."""
    return data_of(path.read_bytes(), path.suffix)


def data_of(content: bytes, suffix: str) -> str:
    """Return the content of a file with that suffix as an address that holds all of it."""
    return f"data:{MEDIA_TYPES[suffix]};base64,{base64.b64encode(content).decode()}"


def number(value: float | None) -> str:
    """Return three significant digits for people: 1.14, 45.0, 1,234; a dash where there is no number."""
    if value is None:
        return "–"
    if value == 0:
        return "0"
    if not math.isfinite(value):
        return f"{value:g}".replace("inf", "∞")
    rounded = float(f"{value:.3g}")
    return f"{value:,.0f}" if abs(rounded) >= 1000 else f"{rounded:#.3g}".removesuffix(".")


def percent(rate: float | None) -> str:
    """Return a rate as a percentage with one decimal, but 0 and 100 only where they are exact."""
    return "–" if rate is None else f"{100 * rate:.1f}" if 0 < rate < 1 else f"{100 * rate:g}"


def seconds(time_s: float | None) -> str:
    """Return a duration: 0.48 s, 12.3 s; a dash where there is none."""
    return "–" if time_s is None else f"{time_s:.1f} s" if time_s >= 10 else f"{time_s:.2f} s"


def words(name: str) -> str:
    """Return a registry name as words: ``pick_place`` -> ``pick place``."""
    return name.replace("_", " ")


def cell(value: Any) -> str:
    """Return what stands in a table's cell: lists joined by commas, a dash where there is nothing."""
    if isinstance(value, list | tuple):
        return ", ".join(map(str, value)) or "–"
    return "–" if value is None else str(value)


def flat(tree: Mapping[str, Any]) -> list[tuple[str, str]]:
    """List nested values, such as a provenance, as (dotted key, text)."""
    leaves = ((key, value) for key, value in dotted(tree).items() if value != {})
    return [(key, tick_label(value) if isinstance(value, float) else str(value)) for key, value in leaves]
