"""Sensors show what physics says, the same for the same seed; the estimator finds the vehicle from them."""

import numpy as np
import pytest

from aerial_il.core.errors import UnknownNameError
from aerial_il.links.mavlink.estimator import Estimate, Estimator
from aerial_il.links.mavlink.frames import (
    Home,
    altitude_at,
    exponential,
    matrix,
    multiply,
    pressure_at,
    swap_attitude,
    swap_body,
    swap_world,
    swap_yaw,
    yaw_of,
)
from aerial_il.links.mavlink.sensors import Motion, Sensed, Sensors

DT = 0.004
UP = np.array([0.0, 0.0, 9.81])
EAST = np.array([1.0, 0.0, 0.0, 0.0])


def at_rest(quat: np.ndarray = EAST) -> Motion:
    return Motion(np.array([0.3, -0.2, 1.2]), np.zeros(3), quat, np.zeros(3), matrix(quat).T @ UP)


def circling(time_s: float) -> Motion:
    """At rest for 2 s, then on a circle of 0.5 m at up to 1 rad/s, heading along it, banked a little."""
    gone = max(0.0, time_s - 2.0)
    rate, speeding = min(1.0, 0.5 * gone), 0.5 if 0.0 < gone < 2.0 else 0.0
    angle = 0.25 * gone**2 if gone < 2.0 else gone - 1.0
    out, along = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([-np.sin(angle), np.cos(angle), 0.0])
    quat = multiply(exponential(np.array([0.0, 0.0, angle])), exponential(np.array([0.1, 0.0, 0.0])))
    rot, acc = matrix(quat), 0.5 * (speeding * along - rate**2 * out)
    pos = 0.5 * out + [0.0, 0.0, 1.2]
    return Motion(pos, 0.5 * rate * along, quat, rot.T @ [0.0, 0.0, rate], rot.T @ (acc + UP))


def fed(estimator: Estimator, sensors: Sensors, motion: Motion) -> Estimate:
    sensed = sensors.read(motion)
    estimator.predict(swap_body(sensed.accel), swap_body(sensed.gyro))
    if sensed.mag is not None:
        estimator.see_field(swap_body(sensed.mag))
    if sensed.pressure is not None:
        estimator.see_height(altitude_at(sensed.pressure) - sensors.home.alt_m)
    if sensed.pose is not None:
        estimator.see_pose(sensed.pose.pos, yaw_of(sensed.pose.quat))
    if sensed.fix is not None and sensors.gps is not None:
        flat, up = np.hypot(sensors.gps.noise, sensors.gps.drift)
        estimator.see_fix(sensed.fix.pos, sensed.fix.vel, np.array([flat, flat, up]))
    return estimator.estimate


def errors(place: str, seed: int, seconds: float = 25.0) -> np.ndarray:
    sensors = Sensors(place, seed=seed)
    estimator = Estimator(swap_world(np.array(sensors.home.field_gauss)), DT)
    wrong = []
    for tick in range(round(seconds / DT)):
        motion = circling(tick * DT)
        estimate = fed(estimator, sensors, motion)
        if tick * DT > 4.0:
            turned = np.remainder(yaw_of(estimate.quat) - yaw_of(motion.quat) + np.pi, 2.0 * np.pi) - np.pi
            wrong.append([*(estimate.pos - motion.pos), *(estimate.vel - motion.vel), turned])
    return np.array(wrong)


def sensed(count: int, seed: int = 0) -> list[Sensed]:
    sensors = Sensors(seed=seed)
    return [sensors.read(at_rest()) for _ in range(count)]


def test_at_rest_the_specific_force_points_up() -> None:
    mean = np.mean([each.accel for each in sensed(250)], axis=0)
    np.testing.assert_allclose(mean, [0.0, 0.0, -9.81], atol=0.2)


def test_a_vehicle_that_heads_north_has_the_field_ahead() -> None:
    north = exponential(np.array([0.0, 0.0, 0.5 * np.pi]))
    mag = Sensors().read(at_rest(north)).mag
    np.testing.assert_allclose(mag, Home().field_gauss, atol=0.01)


def test_sensors_repeat_by_seed_and_differ_by_it() -> None:
    first, again, other = (np.array([each.accel for each in sensed(50, seed)]) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_a_fix_tells_of_the_past() -> None:
    sensors = Sensors()
    moving = [Motion(np.array([k * DT, 0.0, 1.0]), np.zeros(3), EAST, np.zeros(3), UP) for k in range(250)]
    late = [k * DT - s.fix.pos[0] for k, motion in enumerate(moving) if (s := sensors.read(motion)).fix is not None]
    assert len(late) == 9
    np.testing.assert_allclose(late, 0.1, atol=0.06)


def test_an_unknown_source_of_places_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="rtk, standard, mocap"):
        Sensors("perfect")


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_it_finds_the_vehicle_within_ten_centimetres(seed: int) -> None:
    wrong = errors("rtk", seed)
    rms = np.sqrt(np.mean(np.square(wrong), axis=0))
    assert np.linalg.norm(rms[:3]) < 0.1
    assert np.linalg.norm(rms[3:6]) < 0.05
    assert rms[6] < 0.05


def test_with_motion_capture_it_finds_it_within_a_centimetre() -> None:
    rms = np.sqrt(np.mean(np.square(errors("mocap", 1)), axis=0))
    assert np.linalg.norm(rms[:3]) < 0.01
    assert rms[6] < 0.02


def test_a_receiver_without_corrections_does_not() -> None:
    worst = max(np.sqrt(np.mean(np.square(errors("standard", seed)[:, :3]).sum(axis=1))) for seed in (1, 2))
    assert 0.5 < worst < 6.0


def test_an_unfelt_delay_would_be_seen() -> None:
    sensors = Sensors(seed=1)
    field = swap_world(np.array(sensors.home.field_gauss))
    tuned = Estimator(field, DT)
    deaf = Estimator(field, DT, type(tuned.tuning)(gps_delay_s=0.0, baro_delay_s=0.0))
    wrong: dict[Estimator, list[float]] = {tuned: [], deaf: []}
    for estimator, found in wrong.items():
        sensors = Sensors(seed=1)
        for tick in range(4000):
            motion = circling(tick * DT)
            pos = fed(estimator, sensors, motion).pos
            if tick > 1500:
                found.append(float(np.linalg.norm(pos - motion.pos)))
    assert np.mean(wrong[deaf]) > 1.5 * np.mean(wrong[tuned])


def test_frames_swap_there_and_back() -> None:
    vector, quat = np.array([1.0, 2.0, 3.0]), exponential(np.array([0.3, -0.2, 0.7]))
    np.testing.assert_array_equal(swap_world(swap_world(vector)), vector)
    np.testing.assert_array_equal(swap_body(swap_body(vector)), vector)
    np.testing.assert_allclose(abs(swap_attitude(swap_attitude(quat)) @ quat), 1.0)
    np.testing.assert_allclose(swap_yaw(swap_yaw(0.4)), 0.4)
    body = np.array([0.1, 0.2, 0.3])
    wire = matrix(swap_attitude(quat)) @ swap_body(body)
    np.testing.assert_allclose(wire, swap_world(matrix(quat) @ body), atol=1e-12)


def test_places_and_pressures_go_there_and_back() -> None:
    home = Home()
    np.testing.assert_allclose(home.local(*home.geodetic(np.array([2.0, -1.0, 3.0]))), [2.0, -1.0, 3.0], atol=1e-6)
    np.testing.assert_allclose(altitude_at(pressure_at(489.2)), 489.2, atol=1e-9)
