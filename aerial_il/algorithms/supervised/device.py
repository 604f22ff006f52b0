"""Where the loss is computed, and in which precision."""

from __future__ import annotations

import torch

from aerial_il.core.errors import InvalidValueError


def require_device(name: str) -> None:
    """Refuse a torch device that is not there, or that there cannot be."""
    try:
        device = torch.device(name)
    except RuntimeError as error:
        raise InvalidValueError(f"device={name} is none that torch knows. Use cpu, cuda or cuda:1.") from error
    found = torch.cuda.device_count()
    if device.type == "cuda" and not found:
        raise InvalidValueError(f"device={name} needs a GPU that torch can use; there is none here. Use device=cpu.")
    if device.type == "cuda" and (device.index or 0) >= found:
        raise InvalidValueError(f"device={name}: there are {found} GPUs here, counted from 0.")


def precision(device: str, *, mixed: bool) -> torch.autocast:
    """Return the context in which the loss is computed: bfloat16 where ``mixed`` and on a GPU, else float32."""
    mixed = mixed and device.startswith("cuda")
    return torch.autocast("cuda" if mixed else "cpu", dtype=torch.bfloat16, enabled=mixed)
