"""A network of torch's as an ONNX graph, for :class:`~aerial_il.policies.parts.exported.OnnxPolicy`."""

import logging
import warnings
from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor, nn

from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.exported import ACTIONS, IMAGE, NOISE, STATE, OnnxPolicy
from aerial_il.policies.parts.network import shown

OPSET = 18
EXAMPLES, MOST_WORLDS = 3, 1 << 20  # worlds that the graph is traced with; that it may fly


def onnx_of(policy: ChunkPolicy) -> bytes:
    """Return the network of a policy as an ONNX model of opset 18, for any number of worlds.

    Its inputs are ``state`` (B, To, Do) float32, ``image.NAME`` (B, To, H, W, 3) uint8 for each camera, and ``noise``
    (B, S) float32 where the network has chance; its output ``actions`` (B, Ta, Da) float32, normalised as they are.

    Raises:
        InvalidValueError: the policy is made of several networks, or has an operation that ONNX lacks.
    """
    if type(policy) is not ChunkPolicy:
        raise InvalidValueError(
            f"{type(policy).__name__} is made of several networks, which one graph cannot hold. Clone what it flies: "
            "aerial-il fly policy=RUN episodes=80 out=datasets/own, then aerial-il train dataset=datasets/own; of one "
            "that sees, with policy=flow policy.images=[...] observations=onboard, which is the weaker route."
        )
    inputs = _inputs(policy, EXAMPLES)
    worlds = torch.export.Dim("worlds", min=1, max=MOST_WORLDS)
    network = _Named(policy, tuple(inputs)).cpu().eval()
    logging.getLogger("onnxscript").setLevel(logging.ERROR)  # it tells what it does not fold
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            program = torch.onnx.export(
                network,
                tuple(inputs.values()),
                input_names=list(inputs),
                output_names=[ACTIONS],
                dynamic_shapes={"values": tuple({0: worlds} for _ in inputs)},
                opset_version=OPSET,
                dynamo=True,
                verbose=False,
            )
    except (torch.onnx.errors.OnnxExporterError, RuntimeError) as error:
        raise InvalidValueError(
            f"policy={policy.config.name} computes in a way that torch cannot write as a graph: {_reason(error)}"
        ) from error
    except ModuleNotFoundError as error:
        raise InvalidValueError(f"Exporting needs {error.name}: pip install 'aerial-il[export]'") from error
    assert program is not None
    return program.model_proto.SerializeToString()


def _reason(error: Exception) -> str:
    """Return the first line that says something of what lies beneath an error of torch's exporter."""
    lines = str(error.__cause__ or error).strip().splitlines()
    return next((line.strip() for line in lines if line.strip()), type(error).__name__)


def _inputs(policy: ChunkPolicy, worlds: int) -> Mapping[str, Tensor]:
    """Return examples of all inputs by name."""
    layout, history = policy.interface.layout, policy.config.history
    rng = np.random.default_rng(0)
    inputs = {STATE: torch.from_numpy(rng.normal(size=(worlds, history, layout.size)).astype(np.float32))}
    for name, shape, dtype in zip(layout.images, layout.image_shapes, layout.image_dtypes, strict=True):
        pixels = rng.integers(0, 256, (worlds, history, *shape), np.uint8)
        inputs[IMAGE + name] = torch.from_numpy(pixels if dtype == "uint8" else (pixels / 100.0).astype(dtype))
    if size := policy.network.noise_size:
        inputs[NOISE] = torch.from_numpy(rng.normal(size=(worlds, size)).astype(np.float32))
    return inputs


class _Named(nn.Module):
    """The network with its inputs one by one, as a graph has them."""

    def __init__(self, policy: ChunkPolicy, names: tuple[str, ...]) -> None:
        super().__init__()
        self.network, self.names = policy.network, names

    def forward(self, *values: Tensor) -> Tensor:
        given = dict(zip(self.names, values, strict=True))
        images = {name.removeprefix(IMAGE): value for name, value in given.items() if name.startswith(IMAGE)}
        noise = (given[NOISE],) if NOISE in given else ()
        return self.network(shown(given[STATE], images), *noise)


def apart(policy: ChunkPolicy, exported: OnnxPolicy, *, worlds: int = 64) -> float:
    """Return the largest difference between what both answer to random inputs, in normalised actions."""
    inputs = {name: value.numpy() for name, value in _inputs(policy, worlds).items()}
    images = {name.removeprefix(IMAGE): value for name, value in inputs.items() if name.startswith(IMAGE)}
    answers = [each.answer(inputs[STATE], images, inputs.get(NOISE)) for each in (policy, exported)]
    return float(np.abs(answers[0] - answers[1]).max())
