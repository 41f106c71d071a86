"""Layout of servo packets: DYNAMIXEL Protocol 2.0, and 1.0, which Feetech servos use too.

Sources: ROBOTIS e-Manual, "DYNAMIXEL Protocol 1.0" and "2.0"; Feetech, "SCS/STS protocol manual".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


class Register(NamedTuple):
    """Address, size in bytes and sign encoding of a value of the control table."""

    address: int
    size: int
    #: Whether it is a two's complement.
    signed: bool = False
    #: Bit that is the sign of a magnitude; None for none.
    sign_bit: int | None = None

    def decode(self, data: bytes) -> int:
        """Return the value of the register's bytes.

        >>> Register(56, 2, sign_bit=15).decode(bytes([0x05, 0x80]))
        -5
        """
        value = int.from_bytes(data, "little", signed=self.signed)
        if self.sign_bit is None or not value >> self.sign_bit & 1:
            return value
        return -(value & ~(1 << self.sign_bit))


class RegisterRun(NamedTuple):
    """Neighbouring registers of the control table, read in one packet."""

    begin: int
    data: bytes

    def value(self, register: Register) -> int:
        """Return the value of one of them."""
        at = register.address - self.begin
        return register.decode(self.data[at : at + register.size])


@dataclass(frozen=True, slots=True, kw_only=True)
class Packets:
    """Where a packet keeps what: header, number, length, instruction or error, data, checksum."""

    #: As the SDK calls it.
    version: float
    #: Size of the header, bytes.
    number_at: int
    #: Size of the length, of an address or size in a request, and of the checksum, bytes.
    word: int
    #: Offsets in a reply, bytes.
    error_at: int
    data_at: int
    #: What a ping is answered with: the model number in the first two, or nothing.
    model_bytes: int
    #: Bits of a reply's error that report the servo's state; the others refuse the request.
    alert: int

    def request(self, number: int, instruction: int, given: bytes) -> list[int]:
        """Return a packet with room for the header and checksum that the SDK fills in."""
        length = self.place(1 + len(given) + self.word)
        return [*bytes(self.number_at), number, *length, instruction, *given, *bytes(self.word)]

    def answers(self, reply: list[int], *, number: int, size: int) -> bool:
        """Whether a reply is that servo's, with `size` bytes of data; a refusal carries none."""
        counted_from = self.number_at + 1 + self.word
        length = int.from_bytes(bytes(reply[self.number_at + 1 : counted_from]), "little")
        refused = bool(reply[self.error_at] & ~self.alert)
        wanted = self.data_at - counted_from + self.word + (0 if refused else size)
        return reply[self.number_at] == number and length == wanted

    def place(self, value: int) -> bytes:
        """Return an address, or a size, as a request has it."""
        return value.to_bytes(self.word, "little")


PROTOCOL_2 = Packets(
    version=2.0, number_at=4, word=2, error_at=8, data_at=9, model_bytes=3, alert=0x80
)
#: Every bit of the error is the servo's state: too hot, overloaded, out of voltage.
PROTOCOL_1 = Packets(
    version=1.0, number_at=2, word=1, error_at=4, data_at=5, model_bytes=0, alert=0x7F
)
