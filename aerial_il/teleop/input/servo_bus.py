"""Packets of servos on one serial line: who is asked for a register, and what comes back, checked byte by byte.

Feetech's SCS protocol, as STS3215 servos of SO-100 and SO-101 arms speak it: ``FF FF id length instruction parameters
checksum``, the checksum being the complement of the sum of all after the header (doc.feetech.cn, "SCS protocol").
Dynamixel's protocol 2.0: ``FF FF FD 00 id length(2) instruction parameters crc(2)`` with CRC-16/BUYPASS and a byte FD
stuffed after each FF FF FD (emanual.robotis.com/docs/en/dxl/protocol2). Sync read asks all at once; each answers with
a packet of its own. Registers: doc.feetech.cn (SMS/STS memory table), emanual.robotis.com (X series).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

BROADCAST, SYNC_READ, STATUS = 0xFE, 0x82, 0x55
TURN = 4096  # steps of a whole turn, of both families


@dataclass(frozen=True)
class Register:
    """A number that a servo keeps.

    Attributes:
        address: where. size: bytes. sign_bit: which bit holds the sign, of one that is written as magnitude and sign;
            None for two's complement.
    """

    address: int
    size: int
    sign_bit: int | None = None

    def value(self, data: bytes) -> int:
        """Return the number that ``data``, little-endian, stand for."""
        if self.sign_bit is None:
            return int.from_bytes(data, "little", signed=True)
        bits = int.from_bytes(data, "little")
        size = bits & (1 << self.sign_bit) - 1
        return -size if bits >> self.sign_bit & 1 else size

    def data(self, value: int) -> bytes:
        """Return the bytes of ``value``."""
        if self.sign_bit is None:
            return value.to_bytes(self.size, "little", signed=True)
        return (abs(value) | (value < 0) << self.sign_bit).to_bytes(self.size, "little")


@dataclass(frozen=True)
class Answer:
    """What one servo says: its number, its error bits and the bytes of the register."""

    servo: int
    error: int
    data: bytes


class Language(Protocol):
    """One family's packets."""

    position: Register
    homing: Register

    def sync_read(self, register: Register, servos: Sequence[int]) -> bytes:
        """Return the packet that asks ``servos`` for a register."""
        ...

    def answer(self, answer: Answer) -> bytes:
        """Return the packet by which a servo answers."""
        ...

    def take(self, waiting: bytearray) -> Answer | None:
        """Take the first whole answer off ``waiting``; None if there is none yet.

        Raises:
            DamagedError: what stood there was no packet; a byte of it was dropped, and the next call goes on after it.
        """
        ...


class DamagedError(Exception):
    """Bytes that are no packet, or one whose checksum is wrong."""


class Feetech:
    """STS and SMS servos."""

    position = Register(56, 2, sign_bit=15)
    homing = Register(31, 2, sign_bit=11)
    _HEAD = b"\xff\xff"

    def sync_read(self, register: Register, servos: Sequence[int]) -> bytes:
        return self._packet(BROADCAST, bytes([SYNC_READ, register.address, register.size, *servos]))

    def answer(self, answer: Answer) -> bytes:
        return self._packet(answer.servo, bytes([answer.error]) + answer.data)

    def take(self, waiting: bytearray) -> Answer | None:
        _to_head(waiting, self._HEAD)
        if len(waiting) < 4:
            return None
        servo, length = waiting[2], waiting[3]
        if servo >= BROADCAST or not 2 <= length <= 32:
            raise _dropped(waiting)
        if len(waiting) < 4 + length:
            return None
        if ~sum(waiting[2 : 3 + length]) & 0xFF != waiting[3 + length]:
            raise _dropped(waiting)
        answer = Answer(servo, waiting[4], bytes(waiting[5 : 3 + length]))
        del waiting[: 4 + length]
        return answer

    def _packet(self, servo: int, rest: bytes) -> bytes:
        body = bytes([servo, len(rest) + 1]) + rest
        return self._HEAD + body + bytes([~sum(body) & 0xFF])


class Dynamixel:
    """X series servos, by protocol 2.0."""

    position = Register(132, 4)
    homing = Register(20, 4)
    _HEAD = b"\xff\xff\xfd\x00"

    def sync_read(self, register: Register, servos: Sequence[int]) -> bytes:
        where = register.address.to_bytes(2, "little") + register.size.to_bytes(2, "little")
        return self._packet(BROADCAST, bytes([SYNC_READ]) + where + bytes(servos))

    def answer(self, answer: Answer) -> bytes:
        return self._packet(answer.servo, bytes([STATUS, answer.error]) + answer.data)

    def take(self, waiting: bytearray) -> Answer | None:
        _to_head(waiting, self._HEAD)
        if len(waiting) < 7:
            return None
        servo, length = waiting[4], int.from_bytes(waiting[5:7], "little")
        if servo >= BROADCAST or not 4 <= length <= 64:
            raise _dropped(waiting)
        if len(waiting) < 7 + length:
            return None
        packet = bytes(waiting[: 7 + length])
        if crc16(packet[:-2]) != int.from_bytes(packet[-2:], "little") or packet[7] != STATUS:
            raise _dropped(waiting)
        del waiting[: 7 + length]
        rest = packet[8:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
        return Answer(servo, rest[0], rest[1:])

    def _packet(self, servo: int, rest: bytes) -> bytes:
        stuffed = rest.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
        packet = self._HEAD + bytes([servo]) + (len(stuffed) + 2).to_bytes(2, "little") + stuffed
        return packet + crc16(packet).to_bytes(2, "little")


LANGUAGES: dict[str, Language] = {"feetech": Feetech(), "dynamixel": Dynamixel()}


def crc16(data: Iterable[int]) -> int:
    """Return the CRC-16 with polynomial 8005, most significant bit first, from zero."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x8005 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def _to_head(waiting: bytearray, head: bytes) -> None:
    """Drop what stands before the next head, or before what may become one."""
    start = waiting.find(head)
    if start < 0:
        start = next(i for i in range(len(waiting) + 1) if head.startswith(bytes(waiting[i:])))
    if start:
        del waiting[:start]
        raise DamagedError


def _dropped(waiting: bytearray) -> DamagedError:
    del waiting[:1]
    return DamagedError()
