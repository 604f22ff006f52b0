"""What nobody has labelled is not learned from, whatever lies before and after it."""

import numpy as np
import pytest
import torch

from aerial_il import policies
from aerial_il.policies.parts.network import squared_error, without_gaps

CHUNK, ACTIONS = 8, 3


def test_gaps_are_filled_by_what_was_said_before() -> None:
    actions = torch.arange(6.0)[None, :, None].expand(3, 6, 1)
    valid = torch.tensor([[1.0, 0, 0, 1, 1, 0], [0, 0, 1, 1, 1, 1], [1, 1, 1, 1, 0, 0]])
    assert without_gaps(actions, valid)[..., 0].tolist() == [[0, 0, 0, 3, 4, 4], [2, 2, 2, 3, 4, 5], [0, 1, 2, 3, 3, 3]]


def test_where_all_counts_the_error_is_the_mean_square_to_the_bit() -> None:
    one, other = torch.rand(2, 4, 6, 3)
    assert squared_error(one, other, torch.ones(4, 6)) == torch.nn.functional.mse_loss(one, other)


OTHERS = ("categorical", "recurrent", "lerobot_act", "lerobot_diffusion")  # of choices, of sequences; not ours


@pytest.mark.parametrize("name", [name for name in policies.names() if name not in OTHERS])
def test_only_labelled_actions_are_learned_from(name: str) -> None:
    """Flights in which the expert was asked now and then, as by thrifty DAgger: labels with gaps between them."""
    valid = torch.zeros(4, CHUNK)
    valid[:, [0, 4, 5]] = 1.0
    known = policies.get(name).__dataclass_fields__
    network = policies.get(name)(chunk=CHUNK).build(5, ACTIONS)
    torch.manual_seed(0)
    actions = torch.randn(4, CHUNK, ACTIONS, requires_grad=True)
    loss, _ = network.train().loss(torch.randn(4, known["history"].default, 5), actions, valid)
    loss.backward()
    assert actions.grad is not None
    moved = actions.grad.abs().sum((0, 2)).numpy()
    np.testing.assert_array_equal(moved > 0, valid[0].numpy() > 0)
