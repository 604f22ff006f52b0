"""Fully connected layers as several policies stack them."""

from __future__ import annotations

from itertools import pairwise

from torch import nn

from aerial_il.core.errors import InvalidValueError


def hidden_layers(inputs: int, widths: tuple[int, ...], dropout: float = 0.0) -> list[nn.Sequential]:
    """Return one block of Linear, LayerNorm, GELU and dropout for each of ``widths``."""
    return [_layer(a, b, dropout) for a, b in pairwise((inputs, *widths))]


def check_layers(hidden: tuple[int, ...], dropout: float) -> None:
    """Refuse widths and a dropout that no network can have."""
    if not hidden or min(hidden) < 1:
        raise InvalidValueError(f"hidden is {hidden}; it must name at least one positive width.")
    check_dropout(dropout)


def check_dropout(dropout: float) -> None:
    """Refuse a probability outside [0, 1)."""
    if not 0 <= dropout < 1:
        raise InvalidValueError(f"dropout is {dropout}; it must lie in [0, 1).")


def check_positive(**settings: float) -> None:
    """Refuse settings that are not positive, by name."""
    for name, value in settings.items():
        if value <= 0:
            raise InvalidValueError(f"{name} is {value}; it must be positive.")


def check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """Refuse a value that is not among ``choices``."""
    if value not in choices:
        raise InvalidValueError(f"Unknown {name} {value!r}. Valid: {', '.join(choices)}.")


def _layer(inputs: int, outputs: int, dropout: float) -> nn.Sequential:
    parts: list[nn.Module] = [nn.Linear(inputs, outputs), nn.LayerNorm(outputs), nn.GELU()]
    return nn.Sequential(*parts, *([nn.Dropout(dropout)] if dropout else []))
