"""What is hidden from a policy with eyes is told of its images in training, truly, and by nothing that flies."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn.functional import smooth_l1_loss

import aerial_il
from aerial_il import policies, robots
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.dagger import DAgger
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.algorithms.seeing.auxiliary import BETA, Hidden, Telling
from aerial_il.algorithms.supervised.training_set import prepare
from aerial_il.cli.main import main
from aerial_il.collection.collect import collect
from aerial_il.core.checkpoint import Checkpoint, digest
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode
from aerial_il.evaluation.training_run import read_run
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.layout import TO_BE_SEEN, Layout
from aerial_il.policies.parts.network import PolicySettings, Seen
from aerial_il.policies.parts.vision import VisionNetwork, build_network
from aerial_il.policies.recurrent import Recurrent
from aerial_il.workflows.parts.learned_from import learned_from
from tests.policies.test_registry import NAMES

pytestmark = pytest.mark.render
CELL = ("fa_hexa_arm4", "press_button")
RIG = {"cameras": ["wrist@32x32@25Hz@20ms", "base@32x32"]}
BLIND = MLP(hidden=(32,), chunk=4, ensemble=None, images=("wrist_rgb", "base_rgb"))
EYES = replace(BLIND, masked_fields=("gripper", TO_BE_SEEN))
SHORT = BC(steps=4, batch_size=8, warmup_steps=1, validation=0.0, auxiliary=0.5)


@pytest.fixture(scope="module")
def demos(tmp_path_factory: pytest.TempPathFactory) -> list[Episode]:
    place = tmp_path_factory.mktemp("seen") / "demos"
    with closing(aerial_il.load_batch(*CELL, num_envs=2, **RIG)) as env:
        collect(env, aerial_il.expert(*CELL), range(2), place, progress=False)
    return list(open_dataset(place, cameras=EYES.images))


def hidden_of(demos: list[Episode], policy: MLP = EYES) -> Hidden:
    return Hidden.of(Layout.of(demos[0].spec, policy), demos, 1.0)


def test_labels_are_where_things_were_when_the_image_was_taken(demos: list[Episode]) -> None:
    """Unprojected from the pose of the camera then, a label is the button's place again; out of view there is none."""
    hidden, demo = hidden_of(demos), demos[0]
    (target, column) = next((t, k) for t, k in columns(hidden) if t.field == "button_pos")
    for camera, taken in zip(hidden.cameras, (lambda t: max(t - 1, 0) // 2 * 2, lambda t: t), strict=True):
        told = hidden.labels(demos)[camera.image][0][:, column : column + 3]
        then = np.array([taken(t) for t in range(len(demo) + 1)])
        pose, place = camera.pose({n: values[then] for n, values in demo.obs.items()}), demo.obs[target.field][then]
        seen = np.isfinite(told).all(1)
        assert seen.any()
        np.testing.assert_array_equal(seen, camera.in_view(pose.seen(place)))
        found = pose.placed(camera.unproject(told.astype(float)))
        np.testing.assert_allclose(found[seen], place[seen], atol=1e-4)


def columns(hidden: Hidden):
    starts = np.cumsum([0, *(target.size for target in hidden.targets)])
    return zip(hidden.targets, starts, strict=False)


def test_nothing_that_the_policy_is_shown_is_told_and_all_that_is_hidden_follows(demos: list[Episode]) -> None:
    shown = replace(EYES, masked_fields=("button_travel",))
    assert {target.field for target in hidden_of(demos, shown).targets} == {"button_travel"}
    assert {target.field for target in hidden_of(demos).targets} == {
        "button_pos",
        "button_rot6d",
        "button_travel",
        "peak_force",
    }


def test_a_label_moves_with_the_part_that_is_looked_at(demos: list[Episode]) -> None:
    """A place told right of a whole image is told right of any part: only as far as it lies from that one's middle."""
    hidden = hidden_of(demos)
    layout = Layout.of(demos[0].spec, EYES)
    network = build_network(EYES, layout).train()
    assert isinstance(network, VisionNetwork)
    rows = torch.arange(32.0)[:, None].expand(32, 32)
    image = torch.stack([rows, rows.T, rows], dim=-1).to(torch.uint8).expand(9, 1, 32, 32, 3)
    found = {}
    for eye, name in zip(network.eyes, network.cameras, strict=True):
        eye.register_forward_hook(lambda _, images, __, name=name: found.setdefault(name, images[0]))
    looked = network.look(Seen(torch.zeros(9, 1, layout.size), dict.fromkeys(EYES.images, image)))
    for name, (_, shift) in looked.items():
        middle = (found[name].mean((2, 3)) + 1.0) * 127.5  # the mean row and column of the part
        assert shift is not None
        torch.testing.assert_close(shift[:, 0], (middle[:, 1] - 15.5) / 16, atol=1e-4, rtol=0)
        torch.testing.assert_close(shift[:, 1], -(middle[:, 0] - 15.5) / 16, atol=1e-4, rtol=0)
        assert shift.unique(dim=0).shape[0] > 1
    assert hidden.moves.sum(1).tolist() == [1.0, 1.0], "across and up of the one place"


@pytest.mark.parametrize("name", NAMES)
def test_every_policy_learns_from_it_and_flies_without(demos: list[Episode], name: str, tmp_path) -> None:
    settings = {"images": EYES.images, "masked_fields": EYES.masked_fields, "chunk": 4, "execute": 1}
    config = policies.get(name)(**settings)
    policy = SHORT.train(demos, config, run=tmp_path, progress=False)
    again = aerial_il.load_policy(tmp_path)
    assert "auxiliary" in read_metrics(tmp_path)[-1]
    assert not any("heads" in weight for weight in again.to_checkpoint().arrays)
    assert again.observations == "onboard"
    obs = {name: values[:1] for name, values in demos[0].obs.items()}
    np.testing.assert_array_equal(again.act(obs), policy.act(obs))


def test_what_is_out_of_view_teaches_nothing(demos: list[Episode]) -> None:
    """Neither by its loss nor by a gradient that is no number."""
    data = prepare(
        SHORT.divide(demos, EYES, seed=0), EYES, batch_size=8, device="cpu", seed=0, initial=None, auxiliary=1.0
    )
    network = build_network(EYES, data.interface.layout)
    assert isinstance(network, VisionNetwork)
    assert data.hidden
    telling = Telling(network.eval(), data.hidden)
    obs, actions, valid = data.training.gather(np.arange(8))
    assert isinstance(obs, Seen)
    acted, _ = network.loss(obs, actions, valid)
    loss, logged = telling.loss(obs, actions, valid)
    assert logged["auxiliary"] > 0
    torch.testing.assert_close(loss, acted + logged["auxiliary"])
    nothing = {name: torch.full_like(each, torch.nan) for name, each in obs.labels.items()}
    untold, _ = telling.loss(obs._replace(labels=nothing), actions, valid)
    torch.testing.assert_close(untold, acted)
    untold.backward()
    assert all(p.grad is None or p.grad.isfinite().all() for p in telling.parameters())
    assert all((p.grad == 0).all() for p in telling.heads.parameters())


def test_off_it_leaves_every_weight_as_it_was(demos: list[Episode], tmp_path) -> None:
    """And a tenth of it does not, though the policies are alike in all else."""
    arrays = []
    for weight in (0.0, 0.0, 0.1):
        place = tmp_path / f"{len(arrays)}"
        policy = replace(SHORT, auxiliary=weight).train(demos, EYES, run=place, progress=False)
        arrays.append(policy.to_checkpoint().arrays)
    assert digest(Checkpoint(arrays[0])) == digest(Checkpoint(arrays[1]))
    assert {*arrays[0]} == {*arrays[2]}
    assert digest(Checkpoint(arrays[0])) != digest(Checkpoint(arrays[2]))


def test_places_are_learned_from_frames(demos: list[Episode], tmp_path) -> None:
    """Fails if what is told does not depend on what is seen: the best that can be told blindly is told of nothing."""
    training = replace(SHORT, steps=150, batch_size=16, lr=3e-3, auxiliary=10.0)
    training.train(demos, replace(EYES, crop=1.0), run=tmp_path, progress=False)
    told = [torch.from_numpy(np.concatenate(each)) for each in hidden_of(demos).labels(demos).values()]
    missed = [(each - each.nanmedian(0).values)[each.isfinite()] for each in told]
    blind = np.mean([smooth_l1_loss(each, torch.zeros_like(each), beta=BETA).item() for each in missed])
    assert read_metrics(tmp_path)[-1]["auxiliary"] < 0.6 * blind


def test_where_there_is_nothing_to_tell_it_says_so(demos: list[Episode], tmp_path) -> None:
    for policy, said in (
        (BLIND, "nothing is hidden from it.*observations=onboard"),
        (replace(EYES, images=()), "it sees no colour image.*policy.images"),
        (replace(EYES, masked_fields=("tip_to_button",)), "none varies by itself"),  # it follows from what is shown
    ):
        with pytest.raises(InvalidValueError, match=said):
            SHORT.train(demos, policy, run=tmp_path, progress=False)


@pytest.mark.parametrize("policy", [EYES, Recurrent(images=EYES.images, masked_fields=EYES.masked_fields, chunk=4)])
def test_dagger_learns_from_it_in_every_round(demos: list[Episode], policy: PolicySettings, tmp_path) -> None:
    dagger = DAgger(rounds=1, episodes=2, training=SHORT, between_steps=2)
    with closing(aerial_il.load_batch(*CELL, num_envs=2, **RIG)) as env:
        expert = aerial_il.expert(*CELL)
        learned = dagger.train(demos, policy, run=tmp_path, env=env, expert=expert, collect=collect, progress=False)
    assert learned.observations == "onboard"
    assert learned.config == policy
    for number in (0, 1):
        assert read_metrics(tmp_path / "rounds" / f"{number:03d}" / "training")[-1]["auxiliary"] > 0


def test_what_a_run_that_tells_learned_from_is_known_again(demos: list[Episode], tmp_path, monkeypatch) -> None:
    """Its data hold what it was told, too: by the windows alone they would be another set."""
    monkeypatch.chdir(tmp_path)
    with closing(aerial_il.load_batch(*CELL, num_envs=2, **RIG)) as env:
        collect(env, aerial_il.expert(*CELL), range(2), "demos", progress=False)
    told = ["algorithm.auxiliary=0.5", "algorithm.steps=4", "algorithm.batch_size=8", "algorithm.validation=0"]
    policy = ["policy=mlp", "policy.hidden=[8]", "policy.images=[wrist_rgb,base_rgb]", "observations=onboard"]
    assert main(["train", "dataset=demos", "run=run", "threads=1", "progress=false", *policy, *told]) == 0
    assert len(learned_from(read_run("run"), "demos").kept) == 2


def test_labels_that_would_be_wrong_are_refused(demos: list[Episode], monkeypatch: pytest.MonkeyPatch) -> None:
    spec = demos[0].spec
    late = replace(spec, tier="gusts", disturbances={**spec.disturbances, "estimation": 1.0})
    with pytest.raises(InvalidValueError, match="collect tier=gusts-estimation"):
        hidden_of([replace(demo, spec=late) for demo in demos])
    other = replace(demos[0], spec=replace(spec, task="pull_lever"))
    with pytest.raises(InvalidValueError, match="press_button, pull_lever"):
        hidden_of([*demos, other])
    robot = robots.get("fa_hexa_arm4")
    moved = tuple(replace(camera, pos=(0.0, 0.1, 0.0)) for camera in robot.mounted_cameras)
    monkeypatch.setattr(robots, "get", lambda name: replace(robot, cameras=moved))
    with pytest.raises(InvalidValueError, match=r"\(wrist: .*; wrist: pos|\(wrist: pos"):
        hidden_of(demos)
