"""Images reach the network as they were recorded, something is learned from them, and runs stay exact."""

import shutil
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from aerial_il.algorithms.bc import BC, with_noise
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.algorithms.supervised.loader import Loader
from aerial_il.algorithms.supervised.training_set import TrainingSet, cut_windows, fit_interface, read_demos
from aerial_il.core import checkpoint
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.data.dataset import AHEAD, Dataset
from aerial_il.data.episode import Episode
from aerial_il.data.memory import MEMORY
from aerial_il.data.survey import Survey
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.network import Seen
from tests.algorithms.point_mass import demonstrations
from tests.policies.test_vision import seeing

SIDE = 18
EYES = MLP(
    chunk=1, hidden=(32,), images=("wrist_rgb",), image_features=16, obs_names=("ee_pos",), ensemble=None, crop=1.0
)
SHORT = BC(
    steps=6,
    batch_size=8,
    warmup_steps=1,
    validate_every=3,
    cadence=replace(BC.cadence, log_every=2, checkpoint_every=3),
)


def pointing(episode: Episode, rng: np.random.Generator) -> Episode:
    """Return ``episode`` as one in which each frame has a dot and the action, x and y, says where it is."""
    steps = len(episode)
    places = rng.integers(1, SIDE - 1, (steps + 1, 2))
    frames = rng.integers(0, 40, (steps + 1, SIDE, SIDE, 3), np.uint8)
    for frame, (row, column) in zip(frames, places, strict=True):
        frame[row - 1 : row + 2, column - 1 : column + 2] = 250
    actions = episode.executed_actions.copy()
    actions[:, :2] = episode.obs["ee_pos"][:-1, :2] + 0.2 * (places[:-1] / (SIDE - 1) - 0.5)
    obs = {**episode.obs, "wrist_rgb": frames}
    spec = seeing(episode.spec, "wrist_rgb", side=SIDE)
    return replace(episode, spec=spec, obs=obs, executed_actions=actions, expert_actions=actions)


@pytest.fixture(scope="module")
def demos() -> list[Episode]:
    rng = np.random.default_rng(0)
    return [pointing(episode, rng) for episode in demonstrations(10)]


def test_minibatches_hold_each_window_s_own_frames(demos: list[Episode]) -> None:
    config = replace(EYES, history=3)
    layout, kept = read_demos(demos, config)
    windows = cut_windows(kept, layout, config)
    obs, _, _ = TrainingSet(windows, fit_interface(layout, windows, config)).gather(np.arange(len(windows)))
    assert isinstance(obs, Seen)
    assert obs.state.shape == (len(windows), 3, layout.size)
    assert obs.images["wrist_rgb"].dtype == torch.uint8, "a frame in a minibatch takes a byte per colour"
    index = 0
    for episode in demos[:3]:
        for t in range(len(episode)):
            seen = episode.obs["wrist_rgb"][np.maximum(np.arange(t - 2, t + 1), 0)]
            np.testing.assert_array_equal(obs.images["wrist_rgb"][index], seen)
            index += 1
    assert all(np.shares_memory(f, e.obs["wrist_rgb"]) for f, e in zip(windows.frames["wrist_rgb"], demos, strict=True))


def test_noise_shakes_the_state_and_leaves_images_alone() -> None:
    images = {"wrist_rgb": torch.zeros(2, 1, SIDE, SIDE, 3, dtype=torch.uint8)}
    shaken = with_noise(Seen(torch.zeros(2, 1, 2), images), 1.0)
    assert isinstance(shaken, Seen)
    assert (shaken.state != 0).all()
    assert shaken.images is images


def test_it_learns_where_the_dot_is(demos: list[Episode], tmp_path: Path) -> None:
    """Fails if frames and actions are not those of the same moment, or if nothing reaches the encoder."""
    algorithm = BC(steps=250, batch_size=64, lr=3e-3, warmup_steps=20, ema=0.98, validation=0.1)
    algorithm.train(demos, EYES, run=tmp_path, progress=False)
    last = read_metrics(tmp_path)[-1]
    guess = 0.2 * np.abs(np.arange(1, SIDE - 1) / (SIDE - 1) - 0.5).mean()
    assert last["validation/x"] < 0.35 * guess
    assert last["validation/y"] < 0.35 * guess


def test_a_killed_run_ends_with_the_same_weights(demos: list[Episode], tmp_path: Path) -> None:
    config = replace(EYES, crop=0.9)
    whole = SHORT.train(demos[:2], config, run=tmp_path / "whole", progress=False)
    shutil.copytree(tmp_path / "whole", tmp_path / "cut")
    shutil.rmtree(tmp_path / "cut" / "policy")
    shutil.rmtree(checkpoint.step_folder(tmp_path / "cut", 6))
    again = SHORT.train(demos[:2], config, run=tmp_path / "cut", progress=False)
    for name, weights in whole.network.state_dict().items():
        assert torch.equal(weights, again.network.state_dict()[name]), name


def test_the_run_says_which_share_of_its_time_it_waited(demos: list[Episode], tmp_path: Path) -> None:
    SHORT.train(demos[:2], EYES, run=tmp_path, progress=False)
    shares = [row["wait_share"] for row in read_metrics(tmp_path) if "lr" in row]
    assert len(shares) == 3
    assert all(0 <= share <= 1 for share in shares)


@pytest.mark.parametrize("ahead", [0, 2])
def test_a_loader_hands_out_each_step_and_ends_its_thread(ahead: int) -> None:
    gathered: list[int] = []

    def gather(step: int) -> tuple[torch.Tensor, ...]:
        gathered.append(step)
        return (torch.tensor(step),)

    before = threading.active_count()
    with Loader(gather, first=3, last=9, ahead=ahead) as loader:
        assert [int(loader.take(step)[0]) for step in range(3, 9)] == list(range(3, 9))
    assert gathered == list(range(3, 9))
    assert threading.active_count() == before


def test_an_error_in_the_loader_s_thread_reaches_the_trainer() -> None:
    def gather(step: int) -> tuple[torch.Tensor, ...]:
        raise InvalidValueError(f"step {step}")

    with Loader(gather, first=0, last=9, ahead=2) as loader, pytest.raises(InvalidValueError, match="step 0"):
        loader.take(0)


def test_images_that_will_not_fit_are_refused_with_their_size(
    demos: list[Episode], monkeypatch: pytest.MonkeyPatch
) -> None:
    """After the first episode, not when the memory is full."""
    read: list[int] = []
    loaders = {str(i): lambda i=i: read.append(i) or demos[0] for i in range(1000)}
    monkeypatch.setattr(MEMORY, "room_bytes", lambda: 2**24)
    with pytest.raises(InvalidValueError, match=r"1000 episodes take about 0\.\d GiB; there is room for 0\.0 GiB"):
        read_demos(Dataset(Path("demos"), Survey(loaders)), EYES)
    assert len(read) <= 1 + AHEAD, "no more than what is read ahead"


def test_episodes_without_decoded_images_are_refused(demos: list[Episode]) -> None:
    blind = [replace(e, obs={k: v for k, v in e.obs.items() if k != "wrist_rgb"}) for e in demos[:2]]
    layout, kept = read_demos(blind, EYES)
    with pytest.raises(UnknownNameError, match=r"Unknown image 'wrist_rgb'.*cameras="):
        cut_windows(kept, layout, EYES)
