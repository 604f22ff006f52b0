"""What others' files are misread for: each kind of oddity has its right reading, or a word and a count."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from aerial_il.algorithms.online.demonstrations import read_transitions
from aerial_il.core.errors import DemoError, InvalidValueError, UnknownNameError
from aerial_il.data.dataset import Dataset, open_dataset
from aerial_il.policies.mlp import MLP
from experiments.foreign.layouts import minari, robomimic
from tests.data.formats.recorded import buffered, demo, grey, last, lerobot, pair


def findings(dataset: Dataset) -> dict[str, str]:
    """Return what is wrong with each episode, or odd about it."""
    problems = {uid: str(error) for uid, error in dataset.problems() if error is not None}
    return problems | {uid: " ".join(notes) for uid, notes in dataset.survey.notes.items()}


def terminal(path: Path, **answers: Any) -> list[int]:
    """Return the steps after which a learner from rewards does not look further."""
    _, transitions, _ = read_transitions(
        open_dataset(path, **answers), MLP(), trajectories=None, subsample=1, failures=True, seed=0
    )
    return np.flatnonzero(transitions.terminal).tolist()


@pytest.mark.parametrize(
    ("odd", "says"),
    [
        ({"rewards": np.zeros(9)}, "rewards of another length.*expected 10 rows, got 9"),
        ({"dones": np.zeros((10, 2))}, "done that are not one number a step"),
        ({"obs": {}}, "lacks|observations"),
        ({"next_obs": {"pos": np.ones((9, 3))}}, "next pos of another length"),
    ],
)
def test_an_odd_episode_is_left_out_with_a_word(
    odd: dict[str, Any], says: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = robomimic(tmp_path / "odd.hdf5", demo(10, 2.0), demo(10, 1.0, **odd), demo(10, 3.0))
    dataset = open_dataset(file)
    assert [episode.uid for episode in dataset] == ["demo_0", "demo_2"]
    assert "1 of 3 episodes are left out" in caplog.text
    assert "demo_1" in caplog.text
    with pytest.raises(DemoError, match=f"demo_1 .*({says})|({says})"):
        open_dataset(file, strict=True)
    assert list(findings(dataset)) == ["demo_1"]


def test_an_empty_demonstration_does_not_condemn_the_others(tmp_path: Path) -> None:
    dataset = open_dataset(robomimic(tmp_path / "empty.hdf5", demo(10, 1.0), demo(0, 2.0), demo(10, 3.0)))
    assert dataset.uids == ("demo_0", "demo_2")
    assert "demo_1 has no steps" in findings(dataset)["demo_1"]


def test_a_file_that_says_another_length_is_left_out(tmp_path: Path) -> None:
    short = {**buffered(9, 2.0)}
    path = minari(tmp_path / "m", buffered(9, 1.0), short)
    import h5py

    with h5py.File(path / "data/main_data.hdf5", "a") as file:
        file["episode_1"].attrs["total_steps"] = 12
    assert "another number of actions than its file says" in findings(open_dataset(path))["episode_1"]


def test_a_scalar_is_a_vector_and_odd_fields_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    pos = {"pos": np.ones((10, 3))}
    scalar = robomimic(tmp_path / "scalar.hdf5", demo(10, 1.0, obs={**pos, "grip": np.arange(10.0)}))
    assert open_dataset(scalar)[0].obs["grip"].shape == (11, 1)
    extra = robomimic(tmp_path / "extra.hdf5", demo(10, 1.0, obs={**pos, "more": np.ones((10, 2))}), demo(10, 2.0))
    assert [sorted(episode.obs) for episode in open_dataset(extra)] == [["pos"], ["pos"]]
    assert "more is not in all demonstrations" in caplog.text


def test_depth_in_whole_numbers_is_millimetres(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    far = np.arange(10 * 16 * 16, dtype=np.uint16).reshape(10, 16, 16)
    pictures = {"near_depth": far.astype(np.float32) / 1000, "far_depth": far[..., None]}
    file = robomimic(tmp_path / "depth.hdf5", demo(10, 1.0, obs={"pos": np.ones((10, 3)), **pictures}))
    (episode,) = open_dataset(file, cameras=tuple(pictures))
    for name in pictures:
        assert episode.obs[name].dtype == np.float32
        np.testing.assert_allclose(episode.obs[name][:10], far / 1000, rtol=1e-6)
    assert "the whole numbers of the depth images far_depth as millimetres" in caplog.text
    assert "near_depth as" not in caplog.text


def test_success_is_what_a_file_says_or_what_is_asked_for(tmp_path: Path) -> None:
    file = robomimic(tmp_path / "failed.hdf5", demo(10, 1.0), demo(10, 2.0, rewards=np.zeros(10)))
    said = lambda **answers: [episode.success for episode in open_dataset(file, **answers)]  # noqa: E731
    assert said() == [True, False]
    assert said(success="all") == [True, True]
    assert said(success="reward") == said(success="return:0.5") == [True, False]
    assert said(success="terminal", terminals=True) == [True, True]
    assert said(success="survived", terminals=True) == [False, False]
    with pytest.raises(InvalidValueError, match="success=done is not one of all, reward, return:R"):
        said(success="done")
    for no_number in ("return:R", "return:nan", "return:"):
        with pytest.raises(InvalidValueError, match=f"success={no_number} is not one of"):
            said(success=no_number)


def test_parts_that_a_file_names_can_be_taken(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    masks = {"train": ["demo_0", "demo_2"], "valid": ["demo_1"]}
    file = robomimic(tmp_path / "parts.hdf5", *(demo(10, float(i)) for i in range(3)), masks=masks)
    assert len(open_dataset(file)) == 3
    assert "filter_key=train, valid" in caplog.text
    assert open_dataset(file, filter_key="train").uids == ("demo_0", "demo_2")
    with pytest.raises(UnknownNameError, match="Did you mean 'train'"):
        open_dataset(file, filter_key="trian")
    split = lerobot(tmp_path / "split", [5, 4], info={"splits": {"train": "0:1", "test": "1:2"}})
    assert open_dataset(split, filter_key="test").uids == ("episode_000001",)
    with pytest.raises(InvalidValueError, match="names no parts"):
        open_dataset(robomimic(tmp_path / "whole.hdf5", demo(10, 1.0)), filter_key="train")


@pytest.mark.parametrize(
    ("pictures", "group", "shape", "dtype"),
    [
        (np.zeros((10, 84, 84, 3), np.uint8), "image", (84, 84, 3), "uint8"),
        (np.zeros((10, 3, 84, 84), np.uint8), "image", (84, 84, 3), "uint8"),
        (np.full((10, 84, 80, 4), 9, np.uint8), "image", (84, 80, 3), "uint8"),
        (np.full((10, 84, 84, 3), 0.5, "f4"), "image", (84, 84, 3), "uint8"),
        (np.ones((10, 84, 84, 1), "f4"), "image", (84, 84), "float32"),
        (np.ones((10, 84, 84), "f4"), "image", (84, 84), "float32"),
        (np.ones((10, 84, 84), np.uint16), "image", (84, 84), "float32"),
        (np.ones((10, 4, 4)), "proprio", (4, 4), "float64"),
    ],
)
def test_pictures_are_told_from_numbers(
    pictures: np.ndarray, group: str, shape: tuple[int, ...], dtype: str, tmp_path: Path
) -> None:
    seen = {"pos": np.ones((10, 3)), "agentview_image": pictures}
    file = robomimic(tmp_path / "pictures.hdf5", demo(10, 1.0, obs=seen), demo(10, 2.0, obs=seen))
    dataset = open_dataset(file, cameras=True)
    field = dataset.spec.observation["agentview_image"]
    assert (field.group, field.shape, field.dtype) == (group, shape, dtype)
    values = dataset[1].obs["agentview_image"]
    assert (values.shape, values.dtype) == ((11, *shape), np.dtype(dtype))
    assert ("agentview_image" in open_dataset(file)[0].obs) == (group != "image"), "none is read unless asked for"
    if dtype == "uint8" and pictures.dtype.kind == "f":
        assert (values == 128).all()


def test_floats_that_are_no_colours_are_refused(tmp_path: Path) -> None:
    seen = {"pos": np.ones((10, 3)), "agentview_image": np.full((10, 84, 84, 3), -1.0, "f4")}
    dataset = open_dataset(robomimic(tmp_path / "dark.hdf5", demo(10, 1.0, obs=seen)), cameras=True)
    assert "agentview_image that are no pictures" in findings(dataset)["demo_0"]


def test_transitions_are_cut_where_they_do_not_go_on(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", acts=np.repeat([[0.0], [1.0], [2.0]], 10, 0), dones=np.zeros(30, bool), **pair(3, 10))
    dataset = open_dataset(tmp_path / "a.npz")
    assert [len(episode) for episode in dataset] == [10, 10, 10]
    assert [episode.actions[0, 0] for episode in dataset] == [0, 1, 2]
    np.testing.assert_allclose(dataset[1].obs["observation"][-1], [11.0, 11.0])
    assert terminal(tmp_path / "a.npz") == []


def test_time_limits_bootstrap_and_terminals_do_not(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    pairs = {"acts": np.zeros((20, 1)), "rews": np.ones(20), **pair(2, 10)}
    ends = np.tile(last(10), 2).astype(bool)
    for name, flags in {
        "limit": {"dones": np.zeros(20, bool)},
        "said": {"terminals": ends},
        "done": {"dones": ends},
    }.items():
        np.savez(tmp_path / f"{name}.npz", **pairs, **flags)
    np.savez(tmp_path / "timeouts.npz", **pairs, terminals=np.zeros(20, bool), timeouts=ends)
    assert terminal(tmp_path / "limit.npz") == terminal(tmp_path / "timeouts.npz") == []
    assert terminal(tmp_path / "said.npz") == [9, 19]
    assert terminal(tmp_path / "said.npz", terminals=False) == []
    assert terminal(tmp_path / "done.npz") == []
    assert "ends as open" in caplog.text
    assert terminal(tmp_path / "done.npz", terminals=True) == [9, 19]
    assert open_dataset(tmp_path / "timeouts.npz")[0].truncated[-1]
    assert not open_dataset(tmp_path / "done.npz")[0].truncated[-1], "the end of a file is no time limit"
    assert terminal(minari(tmp_path / "minari", buffered(9, 1.0), buffered(9, 2.0))) == []
    over = buffered(9, 1.0, terminations=last(9).astype(bool), truncations=np.zeros(9, bool))
    assert terminal(minari(tmp_path / "over", over)) == [8]
    failed = robomimic(tmp_path / "failed.hdf5", demo(10, 1.0), demo(10, 2.0, rewards=np.zeros(10)))
    assert terminal(failed) == [9], "done with a reward solved the task; without one it may be a time limit"


def test_rows_are_put_in_order_and_cut_where_frames_are_missing(tmp_path: Path) -> None:
    swapped = open_dataset(lerobot(tmp_path / "swapped", [5, 4], rows=[0, 3, 2, 1, 4, 5, 6, 7, 8]))
    assert swapped[0].actions[:, 0].tolist() == [0.5, 1.5, 2.5, 3.5, 4.5]
    assert "rows out of order, first at step 1" in findings(swapped)["episode_000000"]
    mixed = open_dataset(lerobot(tmp_path / "mixed", [5, 4], rows=[0, 5, 1, 6, 2, 7, 3, 8, 4]))
    assert [episode.actions[-1, 0] for episode in mixed] == [4.5, 103.5]
    assert findings(mixed) == {}

    def later(columns: dict[str, Any]) -> None:
        columns["frame_index"][2:5] += 3

    missing = open_dataset(lerobot(tmp_path / "missing", [5, 4], change=later))
    assert [len(episode) for episode in missing] == [2, 3, 4]
    assert "is cut at 1 of its steps, first at step 2: frames are missing" in findings(missing)["episode_000000"]

    def doubled(columns: dict[str, Any]) -> None:
        columns["frame_index"][2] = 1

    twice = open_dataset(lerobot(tmp_path / "twice", [5, 4], change=doubled))
    assert "two rows of one number. [step 2, field frame_index]" in " ".join(findings(twice).values())


def test_time_stamps_are_held_against_the_rate(tmp_path: Path) -> None:
    gap = open_dataset(
        lerobot(tmp_path / "gap", [5, 4], times=lambda t: t + np.where(np.arange(9) // 3 == 1, 5.0, 0.0))
    )
    assert [len(episode) for episode in gap] == [3, 2, 1, 3]
    assert "first at step 3: time leaps" in findings(gap)["episode_000000"]
    double = lambda t: np.r_[0, 0, 2 / 30, 2 / 30, 4 / 30, t[5:]]  # noqa: E731
    doubled = open_dataset(lerobot(tmp_path / "doubled", [5, 4], times=double))
    assert doubled.uids[-1] == "episode_000001"
    assert "time stamps" in " ".join(findings(doubled).values())
    assert "step 1, field times" in " ".join(findings(doubled).values())
    both = open_dataset(lerobot(tmp_path / "both", [5, 4], times=lambda t: np.r_[0, 0, 0.1, 0.1, 5.0, t[5:]]))
    assert "time stamps that do not advance evenly. [step 1, field times]" in " ".join(findings(both).values())
    slow = lerobot(tmp_path / "slow", [5, 4], times=lambda t: 2 * t)
    with pytest.raises(DemoError, match=r"time stamps of another rate.*control_dt=0\.0666667"):
        open_dataset(slow)
    assert open_dataset(slow, control_dt=1 / 15).spec.control_dt_s == 1 / 15


def test_what_no_rate_is_said_of_is_told_and_can_be_answered(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    np.savez(tmp_path / "a.npz", acts=np.zeros((20, 1)), **pair(2, 10))
    assert open_dataset(tmp_path / "a.npz", control_dt=0.05).spec.control_dt_s == 0.05
    assert "control_dt" not in caplog.text
    assert open_dataset(tmp_path / "a.npz").spec.control_dt_s == 1.0
    assert "a control period of 1 s, as none is said (control_dt=S)" in caplog.text


def test_every_vector_and_still_of_lerobot_is_a_field(tmp_path: Path) -> None:
    Image.fromarray(np.full((12, 10, 3), 7, np.uint8)).save(still := io.BytesIO(), "PNG")
    stills = lambda t, n: [{"bytes": still.getvalue(), "path": None}] * len(t)  # noqa: E731
    extra = {
        "observation.velocity": ("float32", [1], lambda t, n: t[:, None].astype("f4")),
        "observation.effort": ("float32", [2], lambda t, n: np.stack([t, t], 1).astype("f4")),
        "observation.environment_state": ("float32", [2], lambda t, n: np.zeros((len(t), 2), "f4")),
        "observation.images.top": ("image", [12, 10, 3], stills),
    }
    dataset = open_dataset(lerobot(tmp_path / "all", [5, 4], extra=extra), cameras=True)
    episode = dataset[1]
    assert episode.obs["observation.velocity"][:, 0].tolist() == [0, 1, 2, 3, 3]
    assert episode.obs["observation.effort"].shape == (5, 2)
    assert dataset.spec.observation["observation.environment_state"].group == "task"
    assert episode.obs["top_rgb"].shape == (5, 12, 10, 3)
    assert (episode.obs["top_rgb"] == 7).all()


def test_truncated_is_no_terminal(tmp_path: Path) -> None:
    ends = lambda t, n: t == n - 1  # noqa: E731
    reward = ("float32", [1], lambda t, n: t.astype("f4"))
    for name in ("truncated", "terminated", "done"):
        path = lerobot(tmp_path / name, [5, 4], extra={"next.reward": reward, f"next.{name}": ("bool", [1], ends)})
        assert terminal(path) == ([4, 8] if name == "terminated" else [])
        assert open_dataset(path)[0].truncated[-1] == (name == "truncated")
    assert terminal(tmp_path / "done", terminals=True) == [4, 8]


def test_another_unit_is_noticed(tmp_path: Path) -> None:
    demos = [demo(10, float(i + 1)) for i in range(4)]
    demos[2]["actions"] = demos[2]["actions"] * 1000
    found = findings(open_dataset(robomimic(tmp_path / "units.hdf5", *demos)))
    assert list(found) == ["demo_2"]
    assert "is it told in another unit?" in found["demo_2"]


def test_an_episode_shorter_than_the_chunk_trains(tmp_path: Path) -> None:
    from aerial_il.algorithms.bc import BC

    dataset = open_dataset(lerobot(tmp_path / "short", [60, 10, 60]))
    settings = BC(steps=2, warmup_steps=1, validation=0.0)
    policy = settings.train(dataset, MLP(hidden=(8,), chunk=20), run=tmp_path / "run", progress=False)
    assert policy.config.chunk == 20


def test_pictures_follow_their_time_stamps(tmp_path: Path) -> None:
    """15 rows a second beside a video of 30 pictures a second; and rows that are not in order."""
    slow = {"info": {"fps": 15}, "times": lambda t: 2 * t, "cameras": {"top": (48, 64)}}
    for name, rows in {"straight": None, "mixed": [0, 3, 2, 1, 4, 5, 6, 7, 8]}.items():
        dataset = open_dataset(lerobot(tmp_path / name, [5, 4], rows=rows, **slow), cameras=True)
        for first, episode in zip((0.0, 5 / 15), dataset, strict=True):
            wanted = [grey(first + step / 15) for step in range(len(episode))]
            np.testing.assert_allclose(episode.obs["top_rgb"][:-1].mean((1, 2, 3)), wanted, atol=2.5)


def test_sixteen_seconds_of_a_robot_s_camera_fit(tmp_path: Path) -> None:
    path = lerobot(tmp_path / "long", [480], cameras={"top": (480, 640)})
    shape = open_dataset(path, cameras=["top_rgb"])[0].obs["top_rgb"].shape
    assert shape == (481, 480, 640, 3)
    with pytest.raises(DemoError, match=r"too much memory\. expected at most 100 MB, got 42\d MB\..*memory_mb=N"):
        open_dataset(path, cameras=True, memory_mb=100)
    assert len(open_dataset(path, memory_mb=100)[0]) == 480, "what does not look at them needs no room for them"
