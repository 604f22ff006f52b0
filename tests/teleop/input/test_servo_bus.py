"""Packets of servos: those of the manuals byte for byte, and no answer from what a bad line makes of them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerial_il.teleop.input.servo_bus import LANGUAGES, Answer, Dynamixel, Feetech, Register
from tests.teleop.simulated import answers

PROTOCOLS = sorted(LANGUAGES)


def test_dynamixel_packets_are_those_of_its_manual() -> None:
    """emanual.robotis.com, protocol 2.0, "Sync Read": the present positions of servos 1 and 2."""
    asked = Dynamixel().sync_read(Dynamixel.position, [1, 2])
    assert asked == bytes.fromhex("fffffd00fe0900828400040001 02cefa")
    stream = bytes.fromhex("fffffd0001080055 00a60000008cc0 fffffd0002080055 001f080000babe")
    assert [(a.servo, Dynamixel.position.value(a.data)) for a in answers("dynamixel", stream)] == [(1, 166), (2, 2079)]


def test_feetech_packets_are_those_of_its_manual() -> None:
    """The SCS protocol's manual: eight bytes of servos 1 and 2 from register 56, and a position of 1304."""
    assert Feetech().sync_read(Register(56, 8), [1, 2]) == bytes.fromhex("fffffe0682380801 0236")
    (answer,) = answers("feetech", bytes.fromhex("ffff010400 1805dd"))
    assert (answer.servo, Feetech.position.value(answer.data)) == (1, 1304)


@pytest.mark.parametrize(("register", "value", "data"), [
    (Feetech.position, -5, "0580"), (Feetech.position, 4095, "ff0f"), (Feetech.homing, -1234, "d20c"),
    (Dynamixel.position, -5, "fbffffff"),
])  # fmt: skip
def test_signs_are_written_as_each_family_does(register: Register, value: int, data: str) -> None:
    assert register.data(value).hex() == data
    assert register.value(bytes.fromhex(data)) == value


ANSWERS = st.lists(
    st.builds(Answer, st.integers(1, 20), st.integers(0, 255), st.binary(min_size=2, max_size=8)), max_size=6
)


@pytest.mark.parametrize("protocol", PROTOCOLS)
@given(said=ANSWERS, noise=st.binary(max_size=6).filter(lambda data: b"\xff" not in data))
def test_answers_come_back_from_a_stream_with_noise(protocol: str, said: list[Answer], noise: bytes) -> None:
    stream = noise + b"".join(LANGUAGES[protocol].answer(answer) for answer in said)
    assert answers(protocol, stream) == said


@given(data=st.binary(max_size=10), at=st.integers(0, 100), flip=st.integers(1, 255))
def test_a_dynamixel_packet_with_one_byte_changed_says_nothing(data: bytes, at: int, flip: int) -> None:
    packet = bytearray(Dynamixel().answer(Answer(3, 0, data)))
    packet[at % len(packet)] ^= flip
    assert answers("dynamixel", bytes(packet)) == []


@given(data=st.binary(min_size=2, max_size=2), at=st.integers(4, 7), flip=st.integers(1, 255))
def test_a_feetech_packet_with_one_byte_changed_says_nothing(data: bytes, at: int, flip: int) -> None:
    packet = bytearray(Feetech().answer(Answer(3, 0, data)))
    packet[at] ^= flip
    assert answers("feetech", bytes(packet)) == []


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_byte_that_is_lost_costs_its_packet_alone(protocol: str) -> None:
    language = LANGUAGES[protocol]
    packets = [language.answer(Answer(i, 0, language.position.data(1000 + i))) for i in range(1, 7)]
    for lost in range(len(packets[1])):
        cut = packets[1][:lost] + packets[1][lost + 1 :]
        result = answers(protocol, b"".join([packets[0], cut, *packets[2:]]))
        heard = {answer.servo: language.position.value(answer.data) for answer in result}
        assert {servo: 1000 + servo for servo in heard} == heard, "nothing wrong is heard"
        assert {1, 4, 5, 6} <= set(heard)


def test_what_the_adapter_echoes_is_no_answer() -> None:
    for protocol in PROTOCOLS:
        language = LANGUAGES[protocol]
        echo = language.sync_read(language.position, [1, 2])
        said = Answer(1, 0, language.position.data(7))
        assert answers(protocol, echo + language.answer(said)) == [said]
