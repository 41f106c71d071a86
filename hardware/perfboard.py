"""Draws `perfboard.svg`, a plan of the sensor's circuit on a perforated board.

Run `python hardware/perfboard.py` after a change. `nets` follows the plan from hole to hole, and a
test compares what it joins with the pins of the firmware.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from draw import (
    COLS,
    DIM,
    GROUND,
    INK,
    PAPER,
    POWER,
    ROWS,
    SELECT,
    SIGNAL,
    Drawing,
)

HERE = Path(__file__).resolve().parent

#: Column and row of a hole, from 1 at the upper left of the components' side.
Hole = tuple[int, int]

#: A 50 x 70 mm perforated board, pitch 2.54 mm.
SIZE: Hole = (18, 24)

#: Header pins at the left edge: row, and the pin of the Mega that a jumper wire leads to.
MEGA = {
    row: pin
    for first, pins in {
        1: ("5V", "46", "47", "48", "49"),
        12: ("A0", "42", "43", "44", "45"),
        21: ("GND", "8", "12"),
    }.items()
    for row, pin in enumerate(pins, start=first)
}
#: Header pins at the right edge: row and name.
OUT = {21: "GND", 22: "SAFE", 23: "SERVO"}

#: The control pins of a breakout board in the order in which most are printed.
BREAKOUT = ("SIG", "S3", "S2", "S1", "S0", "EN", "VCC", "GND")
MUX_COLUMN = 16
#: Name and first row of the multiplexers.
MUXES = {"row": 1, "col": 12}

#: Bare wire on the solder side, straight from hole to hole.
BARE: tuple[tuple[Hole, Hole], ...] = (
    ((1, 1), (16, 1)),  # 5 V to SIG of the row multiplexer
    ((11, 1), (11, 18)),  # 5 V
    ((13, 6), (13, 21)),  # ground
    ((1, 21), (16, 21)),
    *(((13, row), (16, row)) for row in (6, 8, 17, 19)),  # EN and GND of both
    *(((14, row), (16, row)) for row in (7, 18)),  # VCC of both
    *(((1, row), (2, row)) for row in (2, 3, 4, 5, 12, 13, 14, 15, 16)),
    *(((15, row), (16, row)) for row in (2, 3, 4, 5, 13, 14, 15, 16)),
    ((14, 12), (16, 12)),  # SIG of the column multiplexer
    ((6, 12), (7, 12)),
    ((1, 22), (16, 22)),  # safe line
    ((1, 23), (4, 23)),
    ((8, 23), (16, 23)),  # servo's signal
)
#: Insulated wire on the components' side.
INSULATED: tuple[tuple[Hole, Hole, str], ...] = (
    *(((2, row), (15, row), SELECT) for row in (2, 3, 4, 5, 13, 14, 15, 16)),
    *(((11, row), (14, row), POWER) for row in (7, 18)),
    ((7, 12), (15, 12), SIGNAL),
)
#: Part, its two holes.
PARTS: dict[str, tuple[Hole, Hole]] = {
    "4.7 kΩ": ((14, 12), (14, 8)),
    "1 kΩ": ((2, 12), (6, 12)),
    "100 nF, row": ((15, 7), (15, 8)),
    "100 nF, col": ((15, 18), (15, 19)),
    "10 kΩ": ((9, 21), (9, 22)),
    "330 Ω": ((4, 23), (8, 23)),
}


def nets() -> list[frozenset[str]]:
    """Return the nets of the wires: ``Mega 49``, ``row S0``, ``1 kΩ a`` and others."""
    places: dict[str, Hole] = {f"Mega {name}": (1, row) for row, name in MEGA.items()}
    places |= {f"out {name}": (MUX_COLUMN, row) for row, name in OUT.items()}
    for mux, first in MUXES.items():
        places |= {f"{mux} {pin}": (MUX_COLUMN, first + k) for k, pin in enumerate(BREAKOUT)}
    for part, legs in PARTS.items():
        places |= {f"{part} {leg}": hole for leg, hole in zip("ab", legs, strict=True)}
    joined = [set(holes(*ends)) for ends in BARE]
    joined += [{start, end} for start, end, _ in INSULATED]
    joined += [{hole} for hole in places.values()]
    whole: list[set[Hole]] = []
    for group in joined:
        touching = [other for other in whole if other & group]
        whole = [other for other in whole if other not in touching]
        whole.append(group.union(*touching))
    found = (frozenset(name for name, hole in places.items() if hole in group) for group in whole)
    return [net for net in found if net]


def holes(start: Hole, end: Hole) -> Iterator[Hole]:
    """Return the holes of a straight wire, both ends included."""
    (x, y), (to_x, to_y) = start, end
    if x != to_x and y != to_y:
        raise ValueError(f"the wire from {start} to {end} is not straight")
    for column in range(min(x, to_x), max(x, to_x) + 1):
        for row in range(min(y, to_y), max(y, to_y) + 1):
            yield column, row


PITCH, LEFT, TOP = 28, 250, 110
PCB, COVER, BREAKOUT_PCB, RESISTOR, CERAMIC, TIN = (
    "#efe3c2",
    "#222222",
    "#b3362f",
    "#9ec9de",
    "#d9a441",
    "#9aa5b1",
)


def at(hole: Hole) -> tuple[float, float]:
    """Return where a hole is drawn."""
    return LEFT + PITCH * hole[0], TOP + PITCH * hole[1]


def perfboard() -> Drawing:
    """Draw the plan, seen from the components' side."""
    d = Drawing(1180, 860, title="Plan of the sensor's circuit on a perforated board")
    d.text(40, 44, "The circuit on a perforated board of 50 x 70 mm", size=22, weight=700)
    d.text(
        40, 66, "Components' side. Broken lines are bare wire on the solder side.", color=DIM
    )  # fmt: skip
    x, y = at((1, 1))
    d.box(
        x - 22, y - 22, PITCH * (SIZE[0] - 1) + 44, PITCH * (SIZE[1] - 1) + 44, fill=PCB, round_=6
    )
    for column in range(1, SIZE[0] + 1):
        for row in range(1, SIZE[1] + 1):
            d.dot(*at((column, row)), color="#c9b98d", radius=3.2)
    for start, end in BARE:
        d.wire(at(start), at(end), color=TIN, width=4, dash="7 5")
    for start, end, color in INSULATED:
        d.wire(at(start), *arch(start, end), at(end), color=color, width=4)
    for mux, first in MUXES.items():
        breakout(d, mux, first)
    for name, legs in PARTS.items():
        part(d, name, legs)
    headers(d)
    notes(d)
    return d


def arch(start: Hole, end: Hole) -> list[tuple[float, float]]:
    """Return a way past the legs that stand between two holes."""
    legs = {hole for ends in PARTS.values() for hole in ends}
    if not legs & (set(holes(start, end)) - {start, end}):
        return []
    (x, y), (to_x, _) = at(start), at(end)
    return [(x + 8, y - 12), (to_x - 8, y - 12)]


def breakout(d: Drawing, mux: str, first: int) -> None:
    """Draw a multiplexer's board, which stands over the right edge."""
    x, y = at((MUX_COLUMN, first))
    width, height = 300, 8 * PITCH + 12
    d.box(x - 18, y - 20, width, height, fill=BREAKOUT_PCB, round_=6)
    d.box(x + 110, y + 58, 62, 84, fill=COVER, stroke="none", round_=3)
    d.text(x + 141, y + 104, "4067", size=13, color=PAPER, anchor="middle")
    name = {"row": "Row multiplexer", "col": "Column multiplexer"}[mux]
    d.text(x + 141, y + 10, name, size=14, color=PAPER, anchor="middle", weight=700)
    for k, pin in enumerate(BREAKOUT):
        d.box(x - 7, y + PITCH * k - 7, 14, 14, fill=COVER, stroke="#e3c14b")
        d.text(x + 14, y + PITCH * k + 4, pin, size=12, color=PAPER)
    lines, color, letter = (6, ROWS, "R") if mux == "row" else (2, COLS, "C")
    right = x + width - 32
    for k in range(lines):
        d.wire((right, y + 34 * k), (right + 90, y + 34 * k), color=color, width=4)
        d.box(right - 7, y + 34 * k - 7, 14, 14, fill=COVER, stroke="#e3c14b")
        d.text(right - 14, y + 34 * k + 4, f"C{k}", size=12, color=PAPER, anchor="end")
        d.text(right + 98, y + 34 * k + 5, f"{letter}{k}", size=14, color=color, weight=700)


def part(d: Drawing, name: str, legs: tuple[Hole, Hole]) -> None:
    """Draw a resistor or capacitor with its value."""
    (x, y), (to_x, to_y) = sorted(at(leg) for leg in legs)
    middle, height = (x + to_x) / 2, (y + to_y) / 2
    d.wire((x, y), (to_x, to_y), color=TIN, width=3)
    value = name.split(",")[0]
    if "nF" in name:
        d.box(middle - 8, height - 11, 16, 22, fill=CERAMIC, round_=8)
        d.text(middle - 13, height + 4, value, size=11, anchor="end")
    elif abs(to_x - x) + abs(to_y - y) <= PITCH:
        d.box(middle - 9, height - 11, 18, 22, fill=RESISTOR, round_=9)
        d.text(middle + 14, height + 4, f"{value}, upright", size=12)
    elif x == to_x:
        d.box(x - 9, height - 32, 18, 64, fill=RESISTOR, round_=8)
        d.text(x + 14, height + 4, value, size=12)
    else:
        d.box(middle - 32, y - 9, 64, 18, fill=RESISTOR, round_=8)
        d.text(middle, y - 14, value, size=12, anchor="middle")
    for leg in legs:
        d.dot(*at(leg), color=INK, radius=3.5)


def headers(d: Drawing) -> None:
    """Draw the header pins and what they lead to."""
    names = {"5V": POWER, "GND": GROUND, "A0": SIGNAL}
    words = {"8": "8, safe line", "12": "12, servo"}
    for row, pin in MEGA.items():
        x, y = at((1, row))
        d.box(x - 9, y - 9, 18, 18, fill=COVER, stroke="#e3c14b")
        color = names.get(pin, SELECT if len(pin) == 2 and pin != "12" else DIM)
        d.wire((x - 9, y), (x - 80, y), color=color, width=4)
        d.text(x - 88, y + 5, words.get(pin, pin), anchor="end", weight=700)
    for first in (1, 12, 21):
        x, y = at((1, first))
        d.text(x - 44, y - 18, "Mega", anchor="middle", size=12, color=DIM)
    for row, name in OUT.items():
        x, y = at((MUX_COLUMN, row))
        d.box(x - 9, y - 9, 18, 18, fill=COVER, stroke="#e3c14b")
        d.wire((x + 9, y), (x + 120, y), color=GROUND if name == "GND" else DIM, width=4)
        said = {"GND": "ground", "SAFE": "safe line, to a relay board", "SERVO": "servo's signal"}
        d.text(x + 128, y + 5, said[name])
    d.text(LEFT + PITCH * SIZE[0] + 255, TOP - 2, "ribbon to the sensor", size=13, anchor="end",
           color=DIM)  # fmt: skip


def notes(d: Drawing) -> None:
    """Say what has to be checked."""
    words = (
        "Breakout boards differ: compare the order of the control pins with yours before you "
        "solder. A test follows the plan from hole to hole. It has not been built."
    )
    d.text(40, TOP + PITCH * SIZE[1] + 52, words, size=13, color=DIM)


if __name__ == "__main__":
    perfboard().save(HERE / "perfboard.svg")
