"""The README of an exported policy: what it flies, what it must be shown, how often it succeeded, where it comes from.

Source: https://huggingface.co/docs/hub/model-cards
"""

import yaml

from aerial_il.core.specs import Field
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.tasks import wordings_of
from aerial_il.presentation.hub_readme import plain
from aerial_il.presentation.markdown import table


def model_card(
    policy: ChunkPolicy, *, title: str, result: EvaluationResult | None = None, license: str | None = None
) -> str:
    """Return the README.

    Args:
        policy: what was exported. title: its name. result: of an evaluation, if there is one.
        license: identifier of the hub's; None leaves it out.
    """
    spec, layout, config = policy.spec, policy.interface.layout, policy.config
    fields = [spec.observation[name] for name in (*layout.names, *layout.images)]
    told = wordings_of(spec)
    tell = f"policy.told = {next(iter(told))!r}\n" if told else ""
    bounds = zip(spec.action.labels, spec.action.units, spec.action.low, spec.action.high, strict=True)
    facts = {
        "robot": plain(spec.robot),
        "task": plain(spec.task),
        "instruction": "" if told else plain(spec.instruction),
        "success": _success(result),
        "policy": f"{config.name}: sees {config.history} observations, answers {config.chunk} actions",
        "rate": f"{1 / spec.control_dt_s:g} Hz",
        "commit": _commit(policy),
    }
    parts = [
        _front_matter(title, license),
        f"# {plain(title)}",
        table(("", ""), [row for row in facts.items() if row[1]]),
        "## Fly it",
        "```sh\npip install --no-deps aerial-il\npip install numpy onnxruntime\n```",
        '```python\nimport aerial_il\n\npolicy = aerial_il.load_policy("FOLDER")   # this one\n'
        f"{tell}policy.reset()\n"
        "action = policy.act(obs)   # obs: field -> (n, ...); action: (n, Da); at every control step\n"
        "```",
        "## What it can be told" if told else "",
        "\n".join(f"- {plain(text)}" for text in told),
        "## Observations",
        table(("field", "shape", "unit", "meaning"), map(_row, fields)),
        "## Actions",
        f"`{spec.action.level}`, within its bounds:",
        table(
            ("element", "unit", "lower bound", "upper bound"),
            [(plain(label), plain(unit), f"{low:.4g}", f"{high:.4g}") for label, unit, low, high in bounds],
        ),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _commit(policy: ChunkPolicy) -> str:
    git = (policy.origin.get("provenance") or {}).get("git") or {}
    return str(git.get("sha", ""))


def _success(result: EvaluationResult | None) -> str:
    if result is None:
        return "not evaluated"
    environment = result.provenance.get("environment") or {}
    how = [f"{name} {environment[name]}" for name in ("latency", "execution") if environment.get(name)]
    cell = f"{result.robot} {result.task}, {result.tier}"
    return f"{result.headline()}, {plain(', '.join((cell, *how)))}, in simulation"


def _row(field: Field) -> tuple[str, str, str, str]:
    return plain(field.name), "×".join(map(str, field.shape)), plain(field.unit), plain(field.meaning)


def _front_matter(title: str, license: str | None) -> str:
    data = {
        **({"license": license} if license else {}),
        "tags": ["aerial_il", "robotics", "imitation-learning", "onnx"],
        "model_name": title,
    }
    return f"---\n{yaml.safe_dump(data, sort_keys=False, allow_unicode=True)}---"
