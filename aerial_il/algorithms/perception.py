"""Perception: a policy of the state flies on estimates that networks make of the robot's own images.

1. A policy is cloned from the demonstrations, on the truth.
2. Behind each camera a network learns to tell, with its uncertainty, where things are: from frames of the
   demonstrations and from others in which the objects were moved aside.
3. In each round the policy flies on what the networks tell, and they learn on from its own frames, labelled with the
   truth: it meets views that no demonstration has shown.

The networks estimate what the specification of the observations says is to be seen, in the camera's frame; estimates
are fused over cameras and time (:mod:`aerial_il.policies.perception`). With ``rounds=0`` nothing but the demonstrations
is looked at.

Metrics, one row per round: ``loss``, ``flights`` and ``flights_solved`` of its own, and on
frames of flights that were held out ``validation/<field>``: root mean square of the error per number, in the field's
unit, where the field is a place and in view, or in the field's own numbers.

Sources: A. Loquercio et al., "Learning High-Speed Flight in the Wild", 2021 (a policy's own flights, labelled by who
sees the truth); D. Chen et al., "Learning by Cheating", 2019 (to see and to act are learned one after the other).
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor, nn

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.interactive.problem import Collect
from aerial_il.algorithms.interactive.round_flights import FIRST_SEED, SEEDS_PER_RUN
from aerial_il.algorithms.run.cadence import CADENCE, Evaluate, due
from aerial_il.algorithms.run.folder import PRIOR, RunFolder, flown_in
from aerial_il.algorithms.seeing.frames import Frames, Lessons, Moments, check_room, chosen, drawn, kept_fields
from aerial_il.algorithms.seeing.measurable import (
    check_cameras,
    check_eyes,
    check_labels,
    check_one_task,
    check_states,
    looked_for,
)
from aerial_il.algorithms.seeing.redrawing import Redrawing
from aerial_il.algorithms.supervised.learner import Learner, cosine, precision, require_device
from aerial_il.algorithms.supervised.training_set import split
from aerial_il.core.checks import require_not_negative, require_positive, require_share
from aerial_il.core.composition import plain
from aerial_il.core.contracts import BatchEnv, Observation
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import sync_folder
from aerial_il.core.progress import Progress
from aerial_il.core.provenance import provenance
from aerial_il.core.seeding import named_rng, torch_threads
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import TO_BE_SEEN
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.perception.eyes import Eyes
from aerial_il.policies.perception.network import loss_of, told_of
from aerial_il.policies.perception.policy import PerceivingPolicy
from aerial_il.policies.perception.targets import PLACE

FLIGHTS = "flights"


@dataclass(frozen=True, kw_only=True)
class Perception:
    """A policy of the state with eyes.

    Attributes:
        training: of the policy of the state.
        steps: optimisation steps of the networks before the first flights. more_steps: in each round.
        batch_size: frames in a minibatch. lr: peak learning rate; halved in rounds.
        weight_decay, ema, clip_norm: as of behaviour cloning. width: of the networks' hidden layers.
        frames: of the demonstrations. redrawn: of theirs with the objects elsewhere. flown: of the flights of a round.
        rounds: of its own flights. episodes: flights in each.
        every: control steps of 20 ms from one look to the next. forget: share of what is known that a look keeps.
        execute: control steps that the newest chunk of actions is flown for, without the mean over older ones, which
            were asked for when less was known; 0: as ``policy.execute`` and ``policy.ensemble`` have it.
        validation: share of the demonstrations of which no frame is learned from.
        evaluate_every: rounds between two evaluations; 0 for none.
        device: torch device that the networks of the cameras are trained on; that of the state has ``training.device``.
        mixed_precision: compute in bfloat16: faster on a GPU, and on a CPU that knows bfloat16.
        threads: torch threads.
    """

    name: ClassVar[str] = "perception"
    needs: ClassVar[tuple[str, ...]] = ("env", "collect")
    rewarded: ClassVar[bool] = False
    demonstrated: ClassVar[bool] = True

    training: BC = BC()
    steps: int = 4_000
    more_steps: int = 3_000
    batch_size: int = 64
    lr: float = 1e-3
    weight_decay: float = 1e-4
    ema: float = 0.998
    clip_norm: float = 5.0
    width: int = 256
    frames: int = 6_000
    redrawn: int = 12_000
    flown: int = 8_000
    rounds: int = 1
    episodes: int = 100
    every: int = 2
    forget: float = 0.9
    execute: int = 4
    validation: float = 0.05
    evaluate_every: int = 0
    device: str = "cpu"
    mixed_precision: bool = True
    threads: int = 1

    def __post_init__(self) -> None:
        require_positive(self, "steps", "more_steps", "batch_size", "lr", "clip_norm", "width", "frames", "every")
        require_positive(self, "episodes", "threads", "forget")
        require_not_negative(self, "redrawn", "flown", "rounds", "weight_decay", "evaluate_every", "execute")
        require_share(self, "ema", "validation", below_one=True)
        require_share(self, "forget")

    @property
    def worlds(self) -> int:
        """How many worlds it flies in at once, if nobody says otherwise."""
        return min(self.episodes, 50)

    def train(
        self,
        dataset: Iterable[Episode],
        policy: PolicySettings,
        *,
        run: str | os.PathLike[str],
        env: BatchEnv,
        collect: Collect,
        seed: int = 0,
        evaluate: Evaluate | None = None,
        resume: bool = True,
        progress: bool = True,
    ) -> ChunkPolicy:
        """Learn to act on the truth, then to see it.

        Args:
            dataset: demonstrations with images. policy: of the state, with the images that it is to be looked at.
            run: folder. env: with the same cameras. collect: records flights. seed: decides all chance.
            evaluate: ``(policy, round) -> named numbers``. resume: go on after the last complete round.
            progress: show progress bars.

        Raises:
            InvalidValueError: no images are named, one has no colours, where its camera is is not known, or the
                environment shows objects with errors.
        """
        if not policy.images:
            raise InvalidValueError(
                "algorithm=perception looks at images: name some, e.g. policy.images=[wrist_rgb,base_rgb]."
            )
        require_device(self.device)
        run, demos = Path(run), [_without_images(episode) for episode in dataset if episode.success]
        if not demos:
            raise InvalidValueError("There is no successful demonstration to learn from.")
        check_one_task(demos, "algorithm=perception")
        check_states(demos)
        check_labels(env.spec, "Let it look and fly without: flight_tier={tier}.")
        check_cameras(demos, policy.images)
        check_eyes(policy)
        check_room(demos[0].spec, policy.images, self.frames + self.redrawn + self.rounds * self.flown)
        told = tuple(name for name in policy.masked_fields if name != TO_BE_SEEN)
        state = replace(policy, images=(), masked_fields=told)
        shown, held_out = split(demos, self.validation, seed=seed)
        targets = looked_for(shown, state)
        clone = self.training.train(demos, state, run=run / PRIOR, seed=seed, resume=resume, progress=progress)
        pilot = clone if self.execute == 0 else flying_its_newest(clone, self.execute)
        described = {
            "algorithm": self.name,
            "seed": seed,
            "settings": plain(self),
            "policy": {"name": policy.name, **policy.to_dict()},
            "demonstrations": [demo.uid for demo in demos],
            "environment": flown_in(env),
        }
        with RunFolder.open(run, described, cadence=CADENCE, resume=resume) as folder, torch_threads(self.threads):
            if folder.finished:
                return load_policy(run)
            if not resume:
                shutil.rmtree(run / FLIGHTS, ignore_errors=True)
            with torch.random.fork_rng():
                torch.manual_seed(seed)
                eyes = Eyes.of(demos[0].spec, policy.images, targets, self.width)
            return _Run(self, folder, env, collect, pilot, eyes, shown, held_out, seed, progress).finish(evaluate)


def flying_its_newest(policy: ChunkPolicy, steps: int) -> ChunkPolicy:
    """Return a policy that flies its newest chunk alone, for ``steps`` or all of it, before it predicts again."""
    config = replace(policy.config, execute=min(steps, policy.config.chunk), ensemble=None)
    return ChunkPolicy(config, policy.interface, policy.network, policy.origin)


def _without_images(demo: Episode) -> Episode:
    """Return a demonstration without its images, which are drawn anew."""
    return replace(demo, obs={name: demo.obs[name] for name in demo.spec.observation.state_names})


class _Run:
    """One training: its frames, its networks, and the rounds that are left."""

    def __init__(
        self,
        settings: Perception,
        folder: RunFolder,
        env: BatchEnv,
        collect: Collect,
        pilot: ChunkPolicy,
        eyes: Eyes,
        shown: Sequence[Episode],
        held_out: Sequence[Episode],
        seed: int,
        progress: bool,
    ) -> None:
        self.settings, self.folder, self.env, self.seed, self.progress = settings, folder, env, seed, progress
        self.collect, self.pilot, self.eyes = collect, pilot, eyes
        self.shown, self.held_out = shown, held_out
        self.flown, self.solved, self.started = 0, 0, time.perf_counter()

    def finish(self, evaluate: Evaluate | None) -> ChunkPolicy:
        """Take the rounds that are left."""
        done = self._resumed()
        for number in range(done, self.settings.rounds + 1):
            if number:
                self._fly(number)
            loss = self._learn(number)
            policy = self._policy(number)
            judges = evaluate if due(self.settings.evaluate_every, number) else None
            judged = {f"evaluate/{k}": v for k, v in judges(policy, number).items()} if judges else {}
            row = {"loss": loss, "flights": self.flown, "flights_solved": self.solved, **self._errors(), **judged}
            kept = {"round": number, "elapsed_s": time.perf_counter() - self.started}
            self.folder.log(number, {**row, "elapsed_s": kept["elapsed_s"]})
            saved = policy.to_checkpoint()
            self.folder.save(number, replace(saved, state={**saved.state, **kept}), keep=2)
        policy = self._policy(self.settings.rounds)
        self.folder.finish(policy)
        return policy

    def _resumed(self) -> int:
        """Return the first round that is left, with the networks as they were after the one before."""
        if self.folder.resumed is None:
            return 0
        last = load_policy(self.folder.path)
        assert isinstance(last, PerceivingPolicy)
        self.eyes.load_state_dict(last.eyes.state_dict())
        self.flown = int(last.origin["flights"])
        self.started -= self.folder.resumed.state.get("elapsed_s", 0.0)
        return int(self.folder.resumed.state["round"]) + 1

    def _policy(self, number: int) -> PerceivingPolicy:
        origin = {
            **self.pilot.origin,
            "algorithm": self.settings.name,
            "round": number,
            "flights": self.flown,
            "provenance": provenance(),
        }
        return PerceivingPolicy(
            self.pilot, self.eyes, every=self.settings.every, forget=self.settings.forget, origin=origin
        )

    def _place(self, number: int) -> Path:
        return self.folder.path / FLIGHTS / f"{number:03d}"

    def _fly(self, number: int) -> None:
        """Have the flights of a round on disk, all or none."""
        place = self._place(number)
        if place.exists():
            return
        aside = place.with_name(f"{place.name}.flying")
        first = FIRST_SEED + SEEDS_PER_RUN * self.seed + number * self.settings.episodes
        shutil.rmtree(aside, ignore_errors=True)
        longest = int(1.5 * max(map(len, self.shown)))
        tags = {"algorithm": self.settings.name, "run_seed": self.seed, "round": number}
        seeds = range(first, first + self.settings.episodes)
        options = {"longest": longest, "progress": self.progress}
        self.collect(self.env, self._policy(number), seeds, aside, policy_name="perception", settings=tags, **options)
        os.replace(aside, place)
        sync_folder(place.parent)

    def _own_flights(self, number: int) -> list[Episode]:
        return [*open_dataset(self._place(number), failures=True)]

    def _lessons(self, number: int) -> list[Lessons]:
        """Return all frames of the rounds up to this one as the networks learn from them."""
        parts, self.flown, self.solved = [*self._demonstrated], 0, 0
        for k in range(1, number + 1):
            flights = self._own_flights(k)
            self.flown, self.solved = self.flown + len(flights), self.solved + sum(f.success for f in flights)
            moments = chosen(flights, self.settings.flown, named_rng(self.seed, "flown", str(k)))
            parts += self._frames(flights, moments, f"own frames {k}")
        return Lessons.of(self.eyes, Frames.joined(parts))

    @cached_property
    def _demonstrated(self) -> list[Mapping[str, np.ndarray]]:
        """Frames of the demonstrations, and of scenes in which the objects are elsewhere."""
        rng, settings = named_rng(self.seed, "frames"), self.settings
        parts = self._frames(self.shown, chosen(self.shown, settings.frames, rng), "frames")
        if settings.redrawn:
            redrawing = Redrawing(self.env.model, np.stack([demo.states[0] for demo in self.shown]))
            moments = chosen(self.shown, settings.redrawn, rng)
            moved = partial(redrawing.redrawn, rng=rng)
            parts += self._frames(self.shown, moments, "redrawn scenes", moved=moved)
        return parts

    def _frames(self, flights: Sequence[Episode], moments: Moments, what: str, **options: Any) -> list[Observation]:
        """Return what there is to be seen in moments of flights."""
        looks = named_rng(self.seed, "looks", what)
        frames = drawn(self.env, flights, moments, kept_fields(self.eyes), looks=looks, **options)
        with Progress(total=len(moments), desc=what, unit="frame", disable=not self.progress) as bar:
            parts = []
            for part in frames:
                parts.append(part)
                bar.update(len(part["ee_pos"]))
        return parts

    def _learn(self, number: int) -> float:
        """Train the networks on all frames so far; return the mean loss of the last hundred steps."""
        settings, lessons = self.settings, self._lessons(number)
        steps = settings.more_steps if number else settings.steps
        peak, rng = settings.lr * (0.5 if number else 1.0), named_rng(self.seed, "minibatches", str(number))
        kept = {name: getattr(settings, name) for name in ("weight_decay", "ema", "clip_norm")}
        learner = Learner(self.eyes.to(settings.device), **kept)
        losses = []
        with Progress(total=steps, desc=f"train {settings.name}", unit="step", disable=not self.progress) as bar:
            for step in range(steps):
                rows = rng.integers(len(lessons[0].images), size=settings.batch_size)
                each = [self._loss(eye, lesson, rows) for eye, lesson in zip(self.eyes.eyes, lessons, strict=True)]
                loss = torch.stack(each).sum()
                learner.descend(loss, lr=peak * cosine(step / steps, step, warmup_steps=200, floor=0.02), logged={})
                losses.append(loss.item())
                bar.update()
                if step % 50 == 0:
                    bar.set_postfix_str(f"loss {np.mean(losses[-50:]):.3f}", refresh=False)
        self.eyes.load_state_dict(learner.averaged.state_dict())
        self.eyes.cpu().eval()  # where it flies
        return float(np.mean(losses[-100:]))

    def _loss(self, eye: nn.Module, lessons: Lessons, rows: np.ndarray) -> Tensor:
        """Return the loss of what is told behind one camera of a minibatch of frames."""
        images, known, labels, visible = lessons.batch(rows, self.settings.device)
        with precision(self.settings.device, mixed=self.settings.mixed_precision):
            told = eye(images, known)
        return loss_of(self.eyes.targets.estimated, told.float(), labels, visible)

    @torch.inference_mode()
    def _errors(self) -> dict[str, float]:
        """Return the error of each target on demonstrations that were held out, over all cameras."""
        if not self.held_out:
            return {}
        frames = self._held_out_frames
        missed: dict[str, list[np.ndarray]] = {}
        cameras = zip(self.eyes.cameras, self.eyes.eyes, Lessons.of(self.eyes, frames), strict=True)
        for camera, eye, lessons in cameras:
            pose = camera.pose(frames.obs)
            images, known, _, visible = lessons.batch(np.arange(len(frames)))
            targets = self.eyes.targets.estimated
            for target, told, seen in zip(targets, told_of(targets, eye(images, known)), visible, strict=True):
                values = told.mean.numpy().astype(float)
                if target.kind == PLACE and seen is not None:
                    found, rows = pose.placed(camera.unproject(values)), seen.numpy() > 0
                else:
                    found, rows = target.decode(values, pose), np.ones(len(frames), bool)
                missed.setdefault(target.field, []).append((found - target.values(frames.obs))[rows])
        return {
            f"validation/{name}": float(np.sqrt(np.mean(np.concatenate(each) ** 2))) for name, each in missed.items()
        }

    @cached_property
    def _held_out_frames(self) -> Frames:
        moments = chosen(self.held_out, 2_000, named_rng(self.seed, "held out"))
        return Frames.joined(self._frames(self.held_out, moments, "held-out frames"))
