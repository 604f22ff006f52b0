"""The README of a dataset on a hub: the front matter that the Hugging Face Hub reads, then what people read.

Source: https://huggingface.co/docs/hub/datasets-cards
"""

import html
import re
from collections.abc import Collection, Sequence
from pathlib import Path

import yaml

from aerial_il.core.bounded import read_text
from aerial_il.core.lerobot_names import ENVIRONMENT, IMAGES, STATE
from aerial_il.core.places import README_SIGN
from aerial_il.core.specs import UNKNOWN, EnvSpec, camera_name
from aerial_il.data.summary import Summary
from aerial_il.presentation.markdown import table

SIZES = {1_000: "n<1K", 10_000: "1K<n<10K", 100_000: "10K<n<100K", 1_000_000: "100K<n<1M", 10_000_000: "1M<n<10M"}
LARGEST = "n>10M"
FEATURES = {"proprio": STATE, "task": ENVIRONMENT}
_LICENSE = re.compile(r"^license: ([\w.-]+)$", re.MULTILINE)
_SIGNS = re.compile(r"([\\`*_{}\[\]()#+!|~-])")


def hub_readme(
    summary: Summary,
    *,
    title: str,
    license: str | None,
    load: Sequence[str],
    features: Collection[str] | None = None,
    page: str = "",
) -> str:
    """Return the README.

    Args:
        summary: of the dataset. title: its name.
        license: identifier of the hub's; None leaves it out. load: lines of Python that open it.
        features: names of what a LeRobot dataset has; None for a dataset that is none.
        page: name of the page that lies beside the README, if one does.
    """
    spec, rows = summary.coverage.spec, summary.rows
    seconds, won = sum(row["seconds"] for row in rows), sum(row["success"] for row in rows)
    bounds = zip(spec.action.labels, spec.action.units, spec.action.low, spec.action.high, strict=True)
    actions = [(plain(label), plain(unit), f"{low:.4g}", f"{high:.4g}") for label, unit, low, high in bounds]
    facts = {
        "episodes": f"{len(rows)}, of which {won} successes",
        "steps": f"{sum(row['steps'] for row in rows)} at {1 / spec.control_dt_s:g} Hz, {seconds:.0f} s of flight",
        "robot": plain(spec.robot),
        "task": plain(spec.task),
        "tiers": plain(", ".join(sorted({str(row["tier"]) for row in rows}))),
        "actions": plain(spec.action.level),
    }
    parts = [
        _front_matter(summary, title, license, lerobot=features is not None),
        f"# {plain(title)}",
        plain(spec.instruction),
        f"What it covers, with figures: [{page}]({page}); download it, it opens offline." if page else "",
        table(("", ""), [(key, value) for key, value in facts.items() if value not in ("", UNKNOWN)]),
        "## Load it",
        "\n".join(["```python", *load, "```"]),
        "## Observations",
        _observations(spec, features),
        "## Actions",
        table(("element", "unit", "lower bound", "upper bound"), actions),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def stated_license(readme: Path) -> str | None:
    """Return the licence that a README of ours states, or None."""
    if not readme.is_file():
        return None
    found = _LICENSE.search(read_text(readme).split("\n---", 1)[0])
    return found[1] if found else None


def hub_tags(summary: Summary, *, lerobot: bool) -> list[str]:
    """Return the tags of a dataset; ``lerobot`` as in :func:`hub_readme`."""
    spec = summary.coverage.spec
    named = [name for name in (spec.robot, spec.task) if name != UNKNOWN]
    return [*(["LeRobot"] if lerobot else []), "aerial_il", "imitation-learning", "aerial-manipulation", *named]


def plain(text: str) -> str:
    """Return text that Markdown shows as it stands, on one line."""
    return _SIGNS.sub(r"\\\1", html.escape(" ".join(text.split()), quote=False))


def _observations(spec: EnvSpec, features: Collection[str] | None) -> str:
    """Return the table of the fields, and of a LeRobot dataset of ours the feature in which each is."""
    columns, rows = ("field", "shape", "unit", "meaning"), []
    told = features is not None and not spec.is_foreign
    for field in spec.observation.fields:
        feature = FEATURES.get(field.group) or IMAGES + camera_name(field.name)
        if told and feature not in (features or ()):
            continue
        row = (plain(field.name), "×".join(map(str, field.shape)), plain(field.unit), plain(field.meaning))
        rows.append((*row, f"`{feature}`") if told else row)
    return table((*columns, "in") if told else columns, rows)


def _front_matter(summary: Summary, title: str, license: str | None, *, lerobot: bool) -> str:
    steps = sum(row["steps"] for row in summary.rows)
    data = {
        **({"license": license} if license else {}),
        "task_categories": ["robotics"],
        "tags": hub_tags(summary, lerobot=lerobot),
        "pretty_name": title,
        "size_categories": [next((size for most, size in SIZES.items() if steps < most), LARGEST)],
        **({"configs": [{"config_name": "default", "data_files": "data/*/*.parquet"}]} if lerobot else {}),
    }
    return f"---\n{README_SIGN.decode()}\n{yaml.safe_dump(data, sort_keys=False, allow_unicode=True)}---"
