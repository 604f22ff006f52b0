"""One's own runs, evaluations and datasets as pandas frames, and their figures as matplotlib's."""

from aerial_il.presentation.analysis.demonstrations import dataset, steps
from aerial_il.presentation.analysis.figures import (
    curves,
    learning_curves,
    paired_comparison,
    returns,
    success,
    survival,
    use_style,
)
from aerial_il.presentation.analysis.flights import compare, evaluation
from aerial_il.presentation.analysis.training import metrics, runs

__all__ = [
    "runs",
    "metrics",
    "evaluation",
    "compare",
    "dataset",
    "steps",
    "success",
    "learning_curves",
    "curves",
    "returns",
    "survival",
    "paired_comparison",
    "use_style",
]
