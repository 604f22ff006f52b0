"""Forces are felt through a first-order low-pass of the stated bandwidth, at every physics step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from aerial_il.suite.physics import episode_state
from aerial_il.suite.physics.force_sensing import BANDWIDTH_HZ, keep_sample, sense_forces

DT_S = 0.004


def respond(signal: np.ndarray) -> np.ndarray:
    """Readings (T,) of a force along x whose course is ``signal`` (T,)."""
    forces, found = np.zeros(4 * episode_state.MAX_FORCES), []
    for value in signal:
        sense_forces(np.array([value, 0.0, 0.0]), np.zeros(1, np.int64), forces, DT_S)
        found.append(forces[0])
    return np.array(found)


def test_a_step_is_felt_with_the_time_constant_of_the_bandwidth() -> None:
    readings = respond(np.full(100, 10.0))
    time = DT_S * np.arange(1, 101)
    np.testing.assert_allclose(readings, 10.0 * (1.0 - np.exp(-2.0 * math.pi * BANDWIDTH_HZ * time)))


@pytest.mark.parametrize("hertz", [1.0, 50.0])
def test_slow_forces_pass_and_fast_ones_do_not(hertz: float) -> None:
    time = DT_S * np.arange(1000)
    passed = np.abs(respond(np.sin(2.0 * math.pi * hertz * time))[500:]).max()
    assert passed > 0.98 if hertz < BANDWIDTH_HZ else passed < 0.4


def test_the_largest_and_every_reading_are_kept() -> None:
    forces, userdata = np.zeros(4 * episode_state.MAX_FORCES), np.zeros(episode_state.USERDATA_SIZE)
    readings = []
    for tick, value in enumerate((0.0, 40.0, 0.0, 0.0, 0.0)):
        raw = np.array([0.0, value, 0.0])
        sense_forces(raw, np.zeros(1, np.int64), forces, DT_S)
        keep_sample(raw, np.zeros(1, np.int64), forces, userdata, tick)
        readings.append(forces[1])
    assert forces[3 * episode_state.MAX_FORCES] == max(readings) == readings[1]
    samples = userdata[episode_state.SAMPLES].reshape(episode_state.SUBSTEPS, 6)
    np.testing.assert_array_equal(samples[:, 1], readings)
    np.testing.assert_array_equal(samples[:, 4], [0.0, 40.0, 0.0, 0.0, 0.0])
