"""lerobot's ACT, trained by lerobot's trainer on our dataset, judged by lerobot's evaluator and by ours on equal seeds.

Both evaluators fly the same checkpoint in the same episodes, so that whatever they disagree in lies between them: the
observations, the order of the action's elements, units, time limits, what counts as a success. lerobot's programs run
as they would be called by a user, in processes of their own. Killed at any moment, the same call continues; lerobot's
trainer goes on from its last checkpoint.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import aerial_il
from aerial_il.collection.collect import collect
from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.core.files import write_json
from aerial_il.core.progress import Progress
from aerial_il.core.rendering import require_rendering
from aerial_il.data.dataset import open_dataset
from aerial_il.data.formats import lerobot
from aerial_il.evaluation.result import FILE_NAME, EvaluationResult, load_result
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.evaluation.statistics import mcnemar, paired_difference, wilson
from aerial_il.suite.batch import BatchEnvironment
from experiments.common.demonstrations import NOISE
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, settings_of
from experiments.common.seeds import EVALUATION_SEED
from experiments.common.success import success_row

DISAGREE_PERCENT = 5.0
LAST = Path("checkpoints") / "last" / "pretrained_model"
NOTES = (
    "Both evaluators fly the final checkpoint of one training run, on the same seeds and in calm air; success is the "
    "task's own criterion in both.",
    "lerobot sees the dataset that `aerial-il convert` derives: positions in the world frame, no anchor; its "
    "normalisation, optimiser and temporal ensemble, with network sizes suited to a CPU.",
    "Disagree: share of the seeds on which one counts a success and the other does not; the target is compared with "
    "the upper end of its 95 % interval (Wilson), beside an exact McNemar test, paired by seed. Single environment "
    "and batch agree bit for bit, actions do not: lerobot computes its ensemble in another order.",
)


class LerobotError(AerialError, RuntimeError):
    """A program of lerobot failed."""


@dataclass(frozen=True, kw_only=True)
class Lerobot:
    """Settings.

    Attributes:
        robot, task: the cell. demos: demonstrations. noise: of the expert that demonstrates.
        cameras, image_size: what lerobot's policy sees beside the state; none for the state alone.
        steps, batch_size, lr, chunk, width: of lerobot's training. workers: processes of its data loader.
        episodes: unseen seeds per evaluation. seed: first of the demonstrations, and seed of the training.
        num_envs: worlds flown at once. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "lerobot"
    question: ClassVar[str] = (
        "Do lerobot's evaluator and ours measure the same success for a policy that lerobot trained?"
    )

    robot: str = "fa_hexa_arm4"
    task: str = "reach"
    demos: int = 100
    noise: float = NOISE
    cameras: tuple[str, ...] = ()
    image_size: tuple[int, int] = (64, 64)
    steps: int = 6_000
    batch_size: int = 32
    lr: float = 5e-4
    chunk: int = 20
    width: int = 128
    workers: int = 1
    episodes: int = 100
    seed: int = 0
    num_envs: int = 50
    threads: int = 0

    def __post_init__(self) -> None:
        if min(self.demos, self.episodes, self.steps, self.num_envs) < 1:
            raise InvalidValueError("demos, episodes, steps and num_envs start at 1.")
        if self.seed + self.demos > EVALUATION_SEED:
            raise InvalidValueError(f"Demonstrations from seed {self.seed} on would run into the seeds of evaluation.")

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Collect, train and evaluate what ``folder`` does not hold yet; see :class:`Study`."""
        if self.cameras:
            require_rendering("bench lerobot with cameras")
        folder = Record(folder).place("runs", f"{self.robot}-{self.task}", settings_of(self))
        dataset = self._dataset(folder, progress)
        checkpoint = self._train(folder, dataset)
        theirs, ours = self._judged_by_lerobot(folder, checkpoint), self._judged_by_us(folder, checkpoint, progress)
        rows = [_their_row(theirs), {"evaluator": "aerial-il evaluate", **_short(success_row(ours))}]
        won = {e.seed for e in ours.episodes if e.success}
        they_won = {seed for seed, success in zip(ours.seeds, theirs, strict=True) if success}
        return Report(
            study=self,
            targets=(_equal(len(they_won - won), len(won - they_won), len(theirs)),),
            tables={"Success by evaluator": rows},
            notes=NOTES,
            details={"only_lerobot": sorted(they_won - won), "only_ours": sorted(won - they_won)},
            wall_time_s=sum(json.loads(p.read_text())["seconds"] for p in sorted(folder.glob("*.seconds.json"))),
        )

    def _dataset(self, folder: Path, progress: bool) -> Path:
        """Return the LeRobot dataset of the demonstrations."""
        path, derived = folder / "dataset", folder / "dataset" / "derived" / "lerobot"
        if derived.exists():
            return derived
        with _timed(folder, "collect"):
            env = self._environment(self.demos)
            try:
                expert = aerial_il.expert(self.robot, self.task, noise=self.noise)
                seeds = range(self.seed, self.seed + self.demos)
                collect(env, expert, seeds, path, settings={"noise": self.noise}, progress=progress)
            finally:
                env.close()
            episodes = Progress(open_dataset(path), desc="convert", unit="ep", disable=not progress)
            return lerobot.write(episodes, derived)

    def _train(self, folder: Path, dataset: Path) -> Path:
        """Return what lerobot's trainer has saved at the end."""
        out, done = folder / "training", folder / "train.seconds.json"
        if done.exists():
            return out / LAST
        resuming = (out / LAST / "train_config.json").exists()
        if not resuming:
            shutil.rmtree(out, ignore_errors=True)
        words = [f"--config_path={out / LAST / 'train_config.json'}", "--resume=true"] if resuming else self._words()
        fixed = [f"--dataset.root={dataset}", f"--output_dir={out}"]
        with _timed(folder, "train"):
            _call("lerobot_train", *words, *fixed, log=folder / "train.log")
        return out / LAST

    def _words(self) -> list[str]:
        sizes = {"dim_model": self.width, "dim_feedforward": 2 * self.width, "n_heads": 4, "n_encoder_layers": 2}
        policy = {
            "type": "act", "device": "cpu", "push_to_hub": "false", "pretrained_backbone_weights": "null",
            "chunk_size": self.chunk, "n_action_steps": 1, "temporal_ensemble_coeff": 0.01, "n_vae_encoder_layers": 2,
            "optimizer_lr": self.lr, "optimizer_lr_backbone": self.lr, **sizes,
        }  # fmt: skip
        return [
            f"--dataset.repo_id=local/{self.robot}-{self.task}",
            "--dataset.video_backend=pyav",
            *(f"--policy.{name}={value}" for name, value in policy.items()),
            f"--steps={self.steps}",
            f"--save_freq={max(1, self.steps // 4)}",
            f"--batch_size={self.batch_size}",
            f"--num_workers={self.workers}",
            f"--persistent_workers={'true' if self.workers else 'false'}",
            f"--seed={self.seed}",
            "--env_eval_freq=0",
            "--wandb.enable=false",
        ]

    def _judged_by_lerobot(self, folder: Path, checkpoint: Path) -> list[bool]:
        """Return the success of each seed as lerobot's evaluator sees it."""
        out = folder / "lerobot_eval"
        if not (out / "eval_info.json").exists():
            env = {
                "type": "aerial_il", "task": self.task, "robot": self.robot, "cameras": json.dumps(list(self.cameras)),
                "image_height": self.image_size[0], "image_width": self.image_size[1],
                "discover_packages_path": "aerial_il.suite.faces.lerobot",
            }  # fmt: skip
            words = [f"--env.{name}={value}" for name, value in env.items()]
            words += [f"--policy.path={checkpoint}", "--policy.device=cpu", f"--eval.n_episodes={self.episodes}"]
            words += [f"--eval.batch_size={min(self.num_envs, self.episodes)}", "--eval.use_async_envs=false"]
            with _timed(folder, "lerobot_eval"):
                _call(
                    "lerobot_eval", *words, f"--seed={EVALUATION_SEED}", f"--output_dir={out}", log=folder / "eval.log"
                )
        info = json.loads((out / "eval_info.json").read_text())
        return [bool(success) for success in info["per_task"][0]["metrics"]["successes"]]

    def _judged_by_us(self, folder: Path, checkpoint: Path, progress: bool) -> EvaluationResult:
        out = folder / "evaluation"
        if not (out / FILE_NAME).exists():
            env = self._environment(self.episodes)
            try:
                seeds = range(EVALUATION_SEED, EVALUATION_SEED + self.episodes)
                policy = aerial_il.load_policy(str(checkpoint))
                with _timed(folder, "evaluate"):
                    evaluate(env, policy, seeds, policy_name="lerobot's ACT", progress=progress).save(out)
            finally:
                env.close()
        return load_result(out)

    def _environment(self, episodes: int) -> BatchEnvironment:
        return aerial_il.load_batch(
            self.robot,
            self.task,
            num_envs=min(self.num_envs, episodes),
            cameras=self.cameras,
            image_size=self.image_size,
            num_threads=self.threads,
        )


def _call(program: str, *words: str, log: Path) -> None:
    """Run a program of lerobot without the network.

    Raises:
        LerobotError: it failed; names the log and its last line.
    """
    offline = {"HF_HUB_OFFLINE": "1", "HF_DATASETS_OFFLINE": "1", "HF_HOME": str(log.parent.resolve() / "hub")}
    with open(log, "ab") as file:
        command = [sys.executable, "-m", f"lerobot.scripts.{program}", *words]
        code = subprocess.run(
            command, env={**os.environ, **offline}, stdout=file, stderr=subprocess.STDOUT, check=False
        ).returncode
    if code:
        last = log.read_text(errors="replace").strip().splitlines()[-1:]
        raise LerobotError(f"{program} ended with status {code}: {' '.join(last)} See {log}.")


@contextmanager
def _timed(folder: Path, stage: str) -> Iterator[None]:
    """Keep the wall time of a stage, once it is done, in ``STAGE.seconds.json``."""
    started = time.perf_counter()
    yield
    write_json(folder / f"{stage}.seconds.json", {"seconds": round(time.perf_counter() - started, 1)})


def _their_row(successes: list[bool]) -> Row:
    low, high = wilson(sum(successes), len(successes))
    shares = {"percent": sum(successes) / len(successes), "ci95_low": low, "ci95_high": high}
    percent = {name: round(100 * share, 1) for name, share in shares.items()}
    return {"evaluator": "lerobot-eval", "success": sum(successes), "episodes": len(successes), **percent}


def _short(row: Row) -> Row:
    return {name: row[name] for name in ("success", "episodes", "percent", "ci95_low", "ci95_high")}


def _equal(only_theirs: int, only_ours: int, total: int) -> Target:
    """Return that the evaluators agree: not that nothing was found, but that little can be there."""
    low, high = (100 * end for end in paired_difference(only_theirs, only_ours, total))
    apart = only_theirs + only_ours
    spread = (
        f"{apart}/{total}; ours - lerobot's {low:+.1f} to {high:+.1f} points, p = {mcnemar(only_theirs, only_ours):.3f}"
    )
    what = "seeds on which the evaluators disagree, upper end of the interval"
    return Target(what, "at most", DISAGREE_PERCENT, round(100 * wilson(apart, total).hi, 1), "%", spread)
