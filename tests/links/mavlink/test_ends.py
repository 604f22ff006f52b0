"""Each end alone, against one that is played by the test: clocks, ports, frames and refusals."""

import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import replace

import numpy as np
import pytest

from aerial_il import robots
from aerial_il.core.errors import InvalidValueError
from aerial_il.links.link import LinkError, Mode, RefusedError
from aerial_il.links.mavlink import wire
from aerial_il.links.mavlink.autopilot import Autopilot
from aerial_il.links.mavlink.bench import Bench
from aerial_il.links.mavlink.channels import Channels
from aerial_il.links.mavlink.commander import Commander
from aerial_il.links.mavlink.estimator import Estimate
from aerial_il.links.mavlink.frames import Home
from aerial_il.links.mavlink.protocol import AUTOPILOT, SIMULATOR
from aerial_il.links.mavlink.setpoints import command_message, read_setpoint, setpoint_message
from aerial_il.links.mavlink.simulator import Simulator
from aerial_il.links.mavlink.telemetry import Reader, VehicleState, mode_messages, state_messages
from aerial_il.links.mavlink.wire import Wire, dialect
from aerial_il.links.mavlink.world import CradledWorld
from tests.links.mavlink.conftest import Fly

VEHICLE = robots.get("ua_quad_arm4").vehicle
pytest.importorskip("pymavlink", reason="pymavlink is not installed: pip install 'aerial_il[mavlink]'")


@contextmanager
def simulator(**settings: object) -> Iterator[tuple[Simulator, Wire, list[BaseException]]]:
    """A simulator on a thread, the autopilot's end of its wire, and what went wrong on that thread."""
    simulator = Simulator(CradledWorld("ua_quad_arm4", "reach"), port=0, **settings)  # type: ignore[arg-type]
    errors: list[BaseException] = []

    def run() -> None:
        try:
            simulator.run()
        except LinkError as error:
            errors.append(error)
            simulator.close()

    thread = threading.Thread(target=run)
    thread.start()
    end = Wire(wire.connect("127.0.0.1", simulator.port, "The simulator"), *AUTOPILOT, "The simulator")
    try:
        yield simulator, end, errors
    finally:
        simulator.ended.set()
        end.close()
        thread.join()
        simulator.close()


def controls(time_us: int, level: float = 0.0, *, armed: bool = False) -> object:
    mode = dialect().MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
    return dialect().MAVLink_hil_actuator_controls_message(time_us, [level] * 16, mode, 1)


def hil_sensor(time_us: int) -> object:
    return dialect().MAVLink_hil_sensor_message(time_us, 0, 0, -9.81, 0, 0, 0, 0.2, 0, 0.4, 955.0, 0, 0, 20, 0x1FFF, 0)


def sensors_of(end: Wire) -> object:
    *_, last = end.wait_for("HIL_SENSOR")
    return last


def test_each_step_waits_for_its_controls() -> None:
    with simulator() as (_, end, _):
        stamps = []
        for _ in range(6):
            stamps.append(sensors_of(end).time_usec)
            assert end.poll() == []
            end.send(controls(stamps[-1]))
        assert np.diff(stamps).tolist() == [4000] * 5


def test_gravity_has_the_right_sign_on_the_wire() -> None:
    with simulator() as (_, end, _):
        felt = sensors_of(end)
        np.testing.assert_allclose([felt.xacc, felt.yacc, felt.zacc], [0.0, 0.0, -9.81], atol=0.4)
        np.testing.assert_allclose(felt.abs_pressure, 955.8, atol=1.0)


def test_time_runs_until_a_booting_autopilot_answers() -> None:
    with simulator(boot=True) as (_, end, _):
        stamps = [sensors_of(end).time_usec for _ in range(5)]
        assert np.diff(stamps).tolist() == [4000] * 4
        end.send(controls(stamps[-1]))


def test_truth_is_sent_where_it_is_asked_for() -> None:
    with simulator(truth=True) as (simulated, end, _):
        (truth,) = [m for m in end.wait_for("HIL_SENSOR") if m.get_type() == "HIL_STATE_QUATERNION"]
        pos = Home().local(1e-7 * truth.lat, 1e-7 * truth.lon, 1e-3 * truth.alt)
        np.testing.assert_allclose(pos, simulated.world.motion.pos, atol=0.02)


def test_rotors_turn_only_while_armed() -> None:
    with simulator() as (simulated, end, _):
        for armed in (False, True):
            for _ in range(20):
                end.send(controls(sensors_of(end).time_usec, 1.0, armed=armed))
            sensors_of(end)
            assert simulated.world.held is not armed
            end.send(controls(10_000_000 + 4000 * 21, 0.0))


def test_controls_whose_clock_jumps_back_are_refused() -> None:
    with simulator() as (_, end, errors):
        stamp = sensors_of(end).time_usec
        end.send(controls(stamp))
        sensors_of(end)
        end.send(controls(stamp - 1000))
        with pytest.raises(LinkError):
            sensors_of(end)
    assert "clock jumped back" in str(errors[0])


def test_a_port_in_use_is_refused() -> None:
    world = CradledWorld("ua_quad_arm4", "reach")
    with closing(Simulator(world, port=0)) as first:
        with pytest.raises(LinkError, match=f"Port {first.port} .*another simulator or autopilot may run there"):
            Simulator(world, port=first.port)
        with pytest.raises(LinkError, match="port=4561"):
            Autopilot(VEHICLE, lockstep=True, client=("127.0.0.1", first.port))


def test_nobody_at_a_port_is_told() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        free = taken.getsockname()[1]
    with pytest.raises(LinkError, match="does not listen"):
        Autopilot(VEHICLE, simulator=("127.0.0.1", free), client=("127.0.0.1", free)).run()


@pytest.mark.parametrize("jump", [-4000, 0, 8000])
def test_sensors_whose_clock_jumps_are_refused(jump: int) -> None:
    server, errors = wire.listen("127.0.0.1", 0), []
    autopilot = Autopilot(VEHICLE, simulator=server.getsockname(), client=("127.0.0.1", 9))

    def run() -> None:
        try:
            autopilot.run()
        except LinkError as error:
            errors.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    end = Wire(wire.accept(server, "The autopilot"), *SIMULATOR, "The autopilot")
    end.send(hil_sensor(10_000_000))
    list(end.wait_for("HIL_ACTUATOR_CONTROLS"))
    end.send(hil_sensor(10_000_000 + jump))
    thread.join()
    end.close()
    server.close()
    assert f"went from 10000000 to {10_000_000 + jump} µs" in str(errors[0])


@contextmanager
def joined() -> Iterator[tuple[Wire, Wire]]:
    server = wire.listen("127.0.0.1", 0)
    there = wire.connect(*server.getsockname(), "it")
    ends = Wire(wire.accept(server, "it"), *AUTOPILOT, "it"), Wire(there, 1, 191, "it")
    yield ends
    for end in (*ends, server):
        end.close()


def state(stamp: float, **changed: object) -> VehicleState:
    numbers = np.array([1.0, 2.0, 3.0])
    quat = np.array([0.8, 0.0, 0.6, 0.0])
    plain = VehicleState(
        stamp, numbers, -numbers, quat, 0.1 * numbers, np.arange(4.0), np.ones(4), 0.5, True, Mode.HOLDING
    )
    return replace(plain, **changed)


@pytest.mark.parametrize("mode", [each for each in Mode if each is not Mode.CRASHED])
def test_a_state_arrives_as_it_was_sent(mode: Mode) -> None:
    sent = state(12.34, mode=mode)
    with joined() as (autopilot, client):
        reader = Reader(4, lockstep=True)
        autopilot.send(*mode_messages(sent, 4), *state_messages(sent))
        for message in client.wait_for("LOCAL_POSITION_NED"):
            reader.take(message)
    assert reader.state is not None
    assert (reader.state.mode, reader.state.armed, reader.state.stamp) == (mode, True, 12.34)
    for name in ("pos", "vel", "angvel", "joints", "joint_vel", "opening"):
        np.testing.assert_allclose(getattr(reader.state, name), getattr(sent, name), atol=1e-6)
    np.testing.assert_allclose(abs(reader.state.quat @ sent.quat), 1.0, atol=1e-6)


def test_a_client_refuses_a_clock_that_jumps_back() -> None:
    with joined() as (autopilot, client):
        reader = Reader(4, lockstep=True)
        for stamp in (12.0, 11.0):
            autopilot.send(*mode_messages(state(stamp), 4), *state_messages(state(stamp)))
        for message in client.wait_for("LOCAL_POSITION_NED"):
            reader.take(message)
        *_, late = client.wait_for("LOCAL_POSITION_NED")
        with pytest.raises(LinkError, match=r"jumped back, from 12\.000 to 11\.000 s"):
            reader.take(late)


@pytest.mark.parametrize(
    ("level", "base"),
    [
        ("base_joint", [0.5, -1.0, 1.5, 2.0]),
        ("velocity", [0.5, -1.0, 0.3, -0.7]),
        ("ctbr", [25.0, 0.3, -0.2, 0.1]),
    ],
)
def test_a_set_point_arrives_as_it_was_sent(level: str, base: list[float]) -> None:
    wanted, problem = read_setpoint(setpoint_message(level, np.array(base), 54.0, 0), 0.0, 54.0)
    assert problem == ""
    assert wanted is not None
    assert wanted[0] == level
    np.testing.assert_allclose(wanted[1], base, atol=1e-6)


@pytest.mark.parametrize("level", ["base_joint", "velocity", "ctbr"])
@pytest.mark.parametrize("place", range(4))
def test_a_set_point_that_is_not_finite_changes_nothing(level: str, place: int) -> None:
    commander = Commander(VEHICLE, Channels(VEHICLE), Home())
    now = Estimate(np.array([0.0, 0.0, 1.3]), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    commander.know(10.0, now, VEHICLE.rest_down, 1.0)
    for command in (
        command_message("MAV_CMD_COMPONENT_ARM_DISARM", 1.0),
        command_message("MAV_CMD_NAV_TAKEOFF", *[np.nan] * 6, Home().alt_m + 1.3),
    ):
        (answer,) = commander.obey(command)
        assert answer.result == dialect().MAV_RESULT_ACCEPTED
    held = commander.wanted()
    base = np.full(4, 0.2)
    base[place] = np.nan
    (answer,) = commander.obey(setpoint_message(level, base, 54.0, 0))
    assert "not finite" in answer.text
    *_, answer = commander.obey(command_message("MAV_CMD_DO_SET_MODE", 1.0, 6))
    assert answer.result == dialect().MAV_RESULT_DENIED
    after = commander.wanted()
    assert held is not None
    assert after is not None
    np.testing.assert_array_equal(after[1], held[1])


def test_a_client_refuses_what_cannot_be_flown(fly: Fly) -> None:
    _, client = fly()
    for level, action, problem in (
        ("base_joint", np.full(9, np.nan), "finite"),
        ("base_joint", np.zeros(3), "9 finite numbers"),
        ("ee_pose", np.zeros(10), "base_joint, velocity, ctbr"),
    ):
        with pytest.raises(RefusedError, match=problem):
            client.send(level, action)
    for what, problem in (
        ("take_off", "not armed"),
        ("land", "It stands"),
        ("hover", "not fly"),
        ("dance", "no order"),
    ):
        with pytest.raises(RefusedError, match=problem):
            client.order(what)
    client.arm()
    with pytest.raises(RefusedError, match="0 to 2 m"):
        client.order("take_off", height_m=5.0)
    client.take_off(0.3)
    with pytest.raises(RefusedError, match="land first"):
        client.order("disarm")
    with pytest.raises(RefusedError, match="MAV_RESULT_UNSUPPORTED"):
        client.command("MAV_CMD_DO_FLIGHTTERMINATION", 1.0)


def test_a_client_that_hangs_up_ends_the_flight(fly: Fly) -> None:
    bench, client = fly()
    client.close()
    bench.close()
    assert bench.error is None


def test_a_bench_closes_while_its_client_waits(fly: Fly) -> None:
    bench, client = fly()
    bench.close()
    with pytest.raises(LinkError, match="hung up"):
        client.command("MAV_CMD_NAV_LAND")


def test_a_bench_closes_before_a_client_comes() -> None:
    Bench(port=0, lockstep=True).close()


@pytest.mark.parametrize("robot", ["ua_quad_arm4", "big_four_z1", "fa_hexa_arm4"])
def test_controls_mean_the_same_at_both_ends(robot: str) -> None:
    vehicle = robots.get(robot).vehicle
    channels = Channels(vehicle)
    thrust, joints = 0.37 * vehicle.rotor_max, vehicle.rest_down
    controls = channels.controls(thrust, joints, 0.25)
    assert controls.shape == (16,)
    np.testing.assert_allclose(channels.thrust(controls), thrust, rtol=1e-12)
    np.testing.assert_allclose(channels.arm(controls), [*joints, 0.25], atol=1e-12)


def test_a_missing_pymavlink_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    dialect.cache_clear()
    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20.common", None)
    try:
        with pytest.raises(InvalidValueError, match=r"pip install 'aerial_il\[mavlink\]'"):
            Bench(port=0, lockstep=True)
    finally:
        monkeypatch.undo()
        dialect.cache_clear()
        with suppress(InvalidValueError):
            dialect()
