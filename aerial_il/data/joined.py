"""Several datasets learned from together, each with its share."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec
from aerial_il.data.dataset import Dataset
from aerial_il.data.episode import Episode
from aerial_il.data.survey import Loader, Survey


class Joined(Dataset):
    """The episodes of several datasets, one dataset after the other.

    Args:
        datasets: of one environment, or of tasks that can be learned together.
        weights: the share of the training that each has, relative to the others; empty for what their sizes give.

    Raises:
        InvalidValueError: weights do not match or are not positive, two datasets hold one episode, or their fields
            differ.
    """

    def __init__(self, datasets: Sequence[Dataset], weights: Sequence[float] = ()) -> None:
        _check_weights(datasets, weights)
        self._shares, self._paths = tuple(weights), [dataset.path for dataset in datasets]
        self._of: dict[str, int] = {}
        loaders: dict[str, Loader] = {}
        for number, (dataset, spec) in enumerate(zip(datasets, _agreed(datasets), strict=True)):
            for name in dataset.uids:
                uid = f"{dataset.path.resolve()}/{name}" if spec.is_foreign else name  # others count from 0
                if uid in loaders:
                    there = datasets[self._of[uid]].path
                    raise InvalidValueError(f"{there} and {dataset.path} both hold episode {uid}: name one of them.")
                loaders[uid], self._of[uid] = partial(_loaded, dataset, name, uid, spec), number
        parts = [part for dataset in datasets for part in dataset.parts]
        super().__init__(datasets[0].path, Survey(loaders), parts, strict=datasets[0].strict)

    def weighted(self, demos: Sequence[Episode], weights: np.ndarray) -> np.ndarray:
        """Return ``weights`` (E,) of the demonstrations to train on, such that each dataset has its share of the steps.

        Raises:
            InvalidValueError: nothing is left of one that has a share.
        """
        if not self._shares:
            return weights
        of = np.array([self._of[demo.uid] for demo in demos])
        steps = np.bincount(of, weights * [demo.known.sum() for demo in demos], len(self._shares))
        if not steps.all():
            path, share = self._paths[number := int(np.argmin(steps))], self._shares[number]
            raise InvalidValueError(
                f"{path} has a share of {share:g} (dataset.weights) and no episode to train on: none succeeded, or it "
                "was held out or left out. Leave it out, or see algorithm.validation and algorithm.selection."
            )
        return weights * (np.array(self._shares) / steps)[of]


def _loaded(dataset: Dataset, name: str, uid: str, spec: EnvSpec) -> Episode:
    episode = dataset[name]
    return replace(episode, uid=uid, spec=spec if spec.is_foreign else episode.spec)


def _check_weights(datasets: Sequence[Dataset], weights: Sequence[float]) -> None:
    if weights and len(weights) != len(datasets):
        raise InvalidValueError(f"There are {len(datasets)} datasets and {len(weights)} dataset.weights: one for each.")
    for weight in weights:
        if not 0 < weight < math.inf:
            raise InvalidValueError(
                f"dataset.weights has {weight}; each must be positive. Leave a dataset out instead."
            )


def _agreed(datasets: Sequence[Dataset]) -> list[EnvSpec]:
    """Return the specification of each; others' files, of which bounds and length are read off, get wide ones."""
    specs = [dataset.spec for dataset in datasets]
    if all(spec.is_foreign for spec in specs) and len({spec.action.size for spec in specs}) == 1:
        low, high = (np.stack([getattr(s.action, name) for s in specs]) for name in ("low", "high"))
        most = max(spec.max_steps for spec in specs)
        specs = [replace(s, action=replace(s.action, low=low.min(0), high=high.max(0)), max_steps=most) for s in specs]
    for dataset, spec in zip(datasets, specs, strict=True):
        if spec.task == specs[0].task and (differing := specs[0].differences(spec)):
            raise InvalidValueError(
                f"{datasets[0].path} and {dataset.path} cannot be learned from together: {'; '.join(differing[:3])}."
            )
    return specs
