"""Layout of servo packets: DYNAMIXEL Protocol 2.0, and 1.0, also used by Feetech servos.

Sources: ROBOTIS e-Manual, "DYNAMIXEL Protocol 1.0" and "2.0"; Feetech, "SCS/STS protocol manual".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


class Register(NamedTuple):
    """Address, size in bytes and sign encoding of a value of the control table."""

    address: int
    size: int
    #: Whether the value is a two's complement.
    signed: bool = False
    #: Sign bit of a sign-magnitude value; None for other encodings.
    sign_bit: int | None = None
    #: Name in the manufacturer's table; needed only for registers in messages.
    name: str = ""

    def __str__(self) -> str:
        """Return the name and the address, for messages.

        >>> str(Register(20, 4, name="Homing_Offset"))
        'Homing_Offset (address 20)'
        """
        return f"{self.name} (address {self.address})"

    def encode(self, value: int) -> bytes:
        """Convert a value to the bytes of the register.

        >>> Register(42, 2, sign_bit=15).encode(-5).hex()
        '0580'
        """
        if self.sign_bit is not None and value < 0:
            value = -value | 1 << self.sign_bit
        return value.to_bytes(self.size, "little", signed=value < 0)

    def decode(self, data: bytes) -> int:
        """Convert the bytes of the register to its value.

        >>> Register(56, 2, sign_bit=15).decode(bytes([0x05, 0x80]))
        -5
        """
        value = int.from_bytes(data, "little", signed=self.signed)
        if self.sign_bit is None or not value >> self.sign_bit & 1:
            return value
        return -(value & ~(1 << self.sign_bit))


class RegisterBlock(NamedTuple):
    """Adjacent registers of the control table, read in one packet."""

    start: int
    data: bytes

    def value(self, register: Register) -> int:
        """Return the value of a register in this block."""
        offset = register.address - self.start
        return register.decode(self.data[offset : offset + register.size])


@dataclass(frozen=True, slots=True, kw_only=True)
class PacketLayout:
    """Layout of a packet: header, id, length, instruction or error, data, checksum."""

    #: Protocol version in the SDK.
    version: float
    #: Offset of the servo id, equal to the size of the header, bytes.
    id_offset: int
    #: Size of the length, of an address or size in a request, and of the checksum, bytes.
    word: int
    #: Offsets in a reply, bytes.
    error_offset: int
    data_offset: int
    #: Data bytes in the answer to a ping. The first two are the model number; 0 without one.
    model_bytes: int
    #: Bits of a reply's error that report the servo's state. The other bits refuse the request.
    alert_mask: int
    #: Largest number of a servo; larger ones address all servos at once, or none.
    max_id: int
    #: Baud rates that the servos and the SDK have in common.
    bauds: tuple[int, ...]

    def build_request(self, servo_id: int, instruction: int, data: bytes) -> list[int]:
        """Return a packet with zeros for the header and checksum, which the SDK fills in."""
        length = self.encode_word(1 + len(data) + self.word)
        return [*bytes(self.id_offset), servo_id, *length, instruction, *data, *bytes(self.word)]

    def is_reply_from(self, reply: list[int], *, servo_id: int, size: int) -> bool:
        """Return whether the servo sent this reply, with `size` data bytes or as a refusal."""
        length_end = self.id_offset + 1 + self.word
        length = int.from_bytes(bytes(reply[self.id_offset + 1 : length_end]), "little")
        is_refused = bool(reply[self.error_offset] & ~self.alert_mask)
        expected = self.data_offset - length_end + self.word + (0 if is_refused else size)
        return reply[self.id_offset] == servo_id and length == expected

    def encode_word(self, value: int) -> bytes:
        """Encode an address or a size for a request."""
        return value.to_bytes(self.word, "little")


PROTOCOL_2 = PacketLayout(
    version=2.0,
    id_offset=4,
    word=2,
    error_offset=8,
    data_offset=9,
    model_bytes=3,
    alert_mask=0x80,
    max_id=252,
    bauds=(9_600, 57_600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000),
)
#: All error bits report the servo's state: overheating, overload, voltage.
PROTOCOL_1 = PacketLayout(
    version=1.0,
    id_offset=2,
    word=1,
    error_offset=4,
    data_offset=5,
    model_bytes=0,
    alert_mask=0x7F,
    max_id=253,
    bauds=(38_400, 57_600, 115_200, 500_000, 1_000_000),
)
