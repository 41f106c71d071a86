"""How servo packets are laid out: DYNAMIXEL Protocol 2.0, and 1.0, which Feetech servos speak too.

Sources: ROBOTIS e-Manual, "DYNAMIXEL Protocol 1.0" and "2.0"; Feetech, "SCS/STS protocol manual".
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Packets:
    """Where a packet keeps what."""

    #: As the SDK calls it.
    version: float
    #: Offsets, bytes. `error_at` and `data_at` are of a reply.
    number_at: int
    length_at: int
    instruction_at: int
    error_at: int
    data_at: int
    #: Sizes of the length, of an address or size in a request, and of the checksum.
    length_bytes: int
    address_bytes: int
    check_bytes: int
    #: What a ping is answered with: the model number in the first two, or nothing.
    model_bytes: int
    #: Bits of a reply's error that report the servo's state; the others refuse the request.
    alert: int

    def request(self, number: int, instruction: int, given: bytes) -> list[int]:
        """Return a packet with room for the header and the checksum that the SDK fills in."""
        packet = [0] * (self.instruction_at + 1 + len(given) + self.check_bytes)
        packet[self.number_at], packet[self.instruction_at] = number, instruction
        length = 1 + len(given) + self.check_bytes
        packet[self.length_at : self.length_at + self.length_bytes] = length.to_bytes(
            self.length_bytes, "little"
        )
        packet[self.instruction_at + 1 : self.instruction_at + 1 + len(given)] = given
        return packet

    def answers(self, reply: list[int], *, number: int, size: int) -> bool:
        """Whether a reply is that servo's, with `size` bytes of data; a refusal carries none."""
        length = int.from_bytes(
            bytes(reply[self.length_at : self.length_at + self.length_bytes]), "little"
        )
        refused = bool(reply[self.error_at] & ~self.alert)
        before_data = self.data_at - self.length_at - self.length_bytes
        wanted = before_data + self.check_bytes + (0 if refused else size)
        return reply[self.number_at] == number and length == wanted

    def place(self, value: int) -> bytes:
        """Return an address, or a size, as a request has it."""
        return value.to_bytes(self.address_bytes, "little")


PROTOCOL_2 = Packets(
    version=2.0,
    number_at=4,
    length_at=5,
    instruction_at=7,
    error_at=8,
    data_at=9,
    length_bytes=2,
    address_bytes=2,
    check_bytes=2,
    model_bytes=3,
    alert=0x80,
)
#: Every bit of the error is the servo's state: too hot, overloaded, out of voltage.
PROTOCOL_1 = Packets(
    version=1.0,
    number_at=2,
    length_at=3,
    instruction_at=4,
    error_at=4,
    data_at=5,
    length_bytes=1,
    address_bytes=1,
    check_bytes=1,
    model_bytes=0,
    alert=0x7F,
)
