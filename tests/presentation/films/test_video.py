"""Films show the very episode that was judged, in a form that browsers play, or say why there are none."""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from aerial_il.core.errors import InvalidValueError
from aerial_il.evaluation.failures import kind_of, kinds_of
from aerial_il.evaluation.result import EvaluationResult, load_result
from aerial_il.presentation.films import video
from aerial_il.presentation.films.overlay import Caption, compose, strip_height
from tests.data.crane import CraneBatch, crane_spec


def read(path: Path) -> tuple[av.video.stream.VideoStream, list[np.ndarray]]:
    with av.open(str(path)) as container:
        return container.streams.video[0], [f.to_ndarray(format="rgb24") for f in container.decode(video=0)]


@pytest.fixture(scope="module")
def footage(diver: EvaluationResult, tmp_path_factory: pytest.TempPathFactory) -> video.Footage:
    return video.film(CraneBatch(3), diver, tmp_path_factory.mktemp("films"), successes=1, failures=1)


@pytest.mark.render
def test_the_first_success_and_typical_failure_are_filmed(diver: EvaluationResult, footage: video.Footage) -> None:
    won = next(e.seed for e in diver.episodes if e.success)
    typical = next(iter(kinds_of(diver.episodes)))
    lost = next(e.seed for e in diver.episodes if kind_of(e) == typical)
    assert [clip.episode.seed for clip in footage.clips] == sorted([won, lost])
    assert footage.note == ""
    for clip in footage.clips:
        assert clip.path.name == f"seed_{clip.episode.seed}_{clip.episode.end}.mp4"


@pytest.mark.render
def test_films_are_small_h264_that_starts_at_once(footage: video.Footage) -> None:
    for clip in footage.clips:
        raw = clip.path.read_bytes()
        assert len(raw) < 1_000_000
        assert raw.index(b"moov") < raw.index(b"mdat")
        stream, frames = read(clip.path)
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert stream.average_rate == video.FPS
        height, width = video.VIEW_SIZE
        assert frames[0].shape == (height + strip_height(2 * width), 2 * width, 3)


@pytest.mark.render
def test_films_last_as_long_as_their_episodes(footage: video.Footage) -> None:
    for clip in footage.clips:
        shown = len(read(clip.path)[1]) / video.FPS
        assert shown == pytest.approx(clip.episode.duration_s + video.HOLD_S, abs=2.5 / video.FPS)


def test_flying_again_ends_as_it_did_before(diver: EvaluationResult) -> None:
    env = CraneBatch(2)
    for episode in diver.episodes:
        actions = diver.flights[episode.seed].actions
        assert actions is not None
        infos = [step.info for step in video.fly_again(env, episode.seed, actions)]
        assert bool(infos[-1]["success"][0]) == episode.success
        assert bool(infos[-1]["crash"][0]) == (episode.end == "crash")
        assert not any(info["success"][0] for info in infos[:-1])


def test_without_rendering_there_is_a_reason_instead(diver: EvaluationResult, tmp_path: Path) -> None:
    footage = video.film(CraneBatch(1, renders=False), diver, tmp_path)
    assert footage.clips == ()
    assert "gladLoadGL" in footage.note
    assert list(tmp_path.iterdir()) == []


def test_unknown_cameras_are_named(diver: EvaluationResult, tmp_path: Path) -> None:
    assert "it has scene, wrist" in video.film(CraneBatch(1), diver, tmp_path, cameras=["tail"]).note


def test_a_result_from_disk_cannot_be_filmed(diver: EvaluationResult, tmp_path: Path) -> None:
    loaded = load_result(diver.save(tmp_path))
    episode = loaded.episodes[0]
    with pytest.raises(InvalidValueError, match=f"actions of seed {episode.seed} were not kept"):
        video.film_episode(CraneBatch(1), loaded, episode, tmp_path / "x.mp4", cameras=["scene"])


def test_long_episodes_play_faster(diver: EvaluationResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video, "LONGEST_CLIP_S", 1.0)
    monkeypatch.setattr(CraneBatch, "render", lambda self, *_: np.zeros((*video.VIEW_SIZE, 3), np.uint8))
    episode = next(e for e in diver.episodes if e.end == "timeout")
    clip = video.film_episode(CraneBatch(1), diver, episode, tmp_path / "fast.mp4", cameras=["scene"])
    assert clip.speed == np.ceil(episode.steps * crane_spec().control_dt_s)
    assert len(read(clip.path)[1]) / video.FPS < 1.0 + video.HOLD_S + 0.2


def test_a_broken_film_leaves_nothing_behind(tmp_path: Path) -> None:
    def frames() -> object:
        yield np.zeros((16, 16, 3), np.uint8)
        raise RuntimeError("the world ended")

    with pytest.raises(RuntimeError, match="the world ended"):
        video.write_mp4(tmp_path / "film.mp4", frames(), rate=Fraction(25))
    assert list(tmp_path.iterdir()) == []


def test_the_strip_says_the_outcome() -> None:
    view = np.full((64, 200, 3), 90, np.uint8)
    caption = Caption("reach", 1.0, 0.5, "fly", {"near": True})
    flying, crashed = (compose({"scene": view}, c) for c in (caption, Caption("reach", 1.0, 1.0, "", {}, "crash")))
    assert flying.shape == (64 + strip_height(200), 200, 3)
    np.testing.assert_array_equal(flying[40:64], view[40:])
    assert not np.array_equal(flying[64:], crashed[64:])
