"""Draws `wiring.svg`, `one_pad.svg` and `layouts.svg`: run `python hardware/draw.py`."""

from __future__ import annotations

from html import escape
from pathlib import Path

HERE = Path(__file__).resolve().parent
INK, DIM, PAPER = "#1f2933", "#7b8794", "#ffffff"
POWER, GROUND, SELECT, ROWS, COLS, SIGNAL = (
    "#d64545",
    "#52606d",
    "#8d5bd6",
    "#de7c10",
    "#1b7fbd",
    "#1f9d55",
)
COPPER, VELOSTAT, TAPE = "#d08b4c", "#3e4c59", "#f3e3b3"

#: Pins of the Mega that the paper's set-up needs: label, what it goes to.
SELECTS = {"row": ("49", "48", "47", "46"), "col": ("45", "44", "43", "42")}


class Drawing:
    """SVG elements in the order they were drawn."""

    def __init__(self, width: int, height: int, *, title: str) -> None:
        self.width, self.height = width, height
        self.parts: list[str] = [f"<title>{escape(title)}</title>"]
        self.box(0, 0, width, height, fill=PAPER, stroke="none")

    def box(
        self,
        x: float,
        y: float,
        width: float,
        height: float,
        *,
        fill: str,
        stroke: str = INK,
        round_: float = 0,
        dash: str = "",
    ) -> None:
        """Draw a rectangle."""
        self.parts.append(
            f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="{round_:g}" '
            f'fill="{fill}" stroke="{stroke}" stroke-width="1.5" stroke-dasharray="{dash}"/>'
        )

    def wire(
        self, *points: tuple[float, float], color: str, width: float = 2.2, dash: str = ""
    ) -> None:
        """Draw a line through points."""
        path = " ".join(f"{x:g},{y:g}" for x, y in points)
        self.parts.append(
            f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="{width:g}" '
            f'stroke-linejoin="round" stroke-linecap="round" stroke-dasharray="{dash}"/>'
        )

    def dot(self, x: float, y: float, *, color: str, radius: float = 4.5) -> None:
        """Draw a junction."""
        self.parts.append(f'<circle cx="{x:g}" cy="{y:g}" r="{radius:g}" fill="{color}"/>')

    def text(
        self,
        x: float,
        y: float,
        words: str,
        *,
        size: float = 14,
        color: str = INK,
        anchor: str = "start",
        weight: int = 400,
    ) -> None:
        """Write words; `y` is their base line."""
        self.parts.append(
            f'<text x="{x:g}" y="{y:g}" font-size="{size:g}" fill="{color}" '
            f'text-anchor="{anchor}" font-weight="{weight}">{escape(words)}</text>'
        )

    def save(self, path: Path) -> None:
        """Write the file."""
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width} {self.height}" '
            f'width="{self.width}" height="{self.height}" '
            'font-family="Helvetica, Arial, sans-serif">'
        )
        path.write_text("\n".join([head, *self.parts, "</svg>"]) + "\n")


def multiplexer(
    d: Drawing, x: float, y: float, name: str, *, outputs: int, first: str
) -> dict[str, tuple[float, float]]:
    """Draw a 16-channel multiplexer; return where its pins are."""
    d.box(x, y, 170, 230, fill="#eef2ff", round_=10)
    d.text(x, y - 10, name, weight=700)
    d.text(x + 100, y + 206, "CD74HC4067", anchor="middle", size=12, color=DIM)
    pins: dict[str, tuple[float, float]] = {}
    for k, pin in enumerate(("VCC", "S0", "S1", "S2", "S3", "EN", "GND", "SIG")):
        pins[pin] = (x, y + 24 + 26 * k)
        d.text(x + 8, y + 28 + 26 * k, pin, size=12)
    for k in range(outputs):
        pins[f"{first}{k}"] = (x + 170, y + 24 + 26 * k)
        d.text(x + 162, y + 28 + 26 * k, f"C{k}", size=12, anchor="end")
    d.text(x + 162, y + 28 + 26 * outputs, "... C15", size=12, anchor="end", color=DIM)
    return pins


def wiring() -> Drawing:
    """Draw the paper's set-up: two multiplexers, a divider, eight pixels on two fingers."""
    d = Drawing(1180, 760, title="Wiring of the sensor to an Arduino Mega 2560")
    d.text(40, 44, "Eight pixels, two multiplexers, one divider", size=22, weight=700)
    d.text(
        40, 66, "rigid-2x2: rows R0, R1 on finger 0, rows R2, R3 on finger 1", size=14, color=DIM
    )
    d.box(40, 90, 170, 610, fill="#e3f4f1", round_=12)
    d.text(125, 122, "Arduino", anchor="middle", weight=700)
    d.text(125, 141, "Mega 2560", anchor="middle", weight=700)
    row_mux = multiplexer(d, 470, 110, "Row multiplexer", outputs=4, first="R")
    col_mux = multiplexer(d, 470, 400, "Column multiplexer", outputs=2, first="C")
    matrix(d, row_mux, col_mux)
    power(d, row_mux, col_mux)
    selects(d, row_mux, SELECTS["row"], lane=300)
    selects(d, col_mux, SELECTS["col"], lane=300)
    divider(d, row_mux, col_mux)
    legend(d)
    return d


def one_pad() -> Drawing:
    """Draw one pad and one resistor on an Uno or an ESP32."""
    d = Drawing(760, 330, title="Wiring of one pad and one resistor to an Uno or an ESP32")
    d.text(40, 40, "One pad, one resistor", size=22, weight=700)
    d.box(40, 70, 170, 220, fill="#e3f4f1", round_=12)
    d.text(54, 95, "Uno (ESP32)", weight=700)
    supply, signal, ground = (
        pin(d, 130, "5V (3V3)"),
        pin(d, 190, "A0 (GPIO 34)"),
        pin(d, 260, "GND"),
    )
    d.wire(supply, (700, 130), (700, 158), (640, 158), color=POWER)
    d.wire(signal, (520, 190), color=SIGNAL, width=2.6)
    d.wire(ground, (330, 260), (330, 246), color=GROUND)
    d.wire((330, 202), (330, 190), color=SIGNAL)
    d.box(321, 202, 18, 44, fill=PAPER)
    d.dot(330, 190, color=SIGNAL)
    d.text(350, 229, "resistor 4.7 kΩ", size=13)
    # Velostat extends beyond the copper, so that the two sheets of copper can't touch.
    for top, left, width, color in (
        (151, 520, 120, COPPER),
        (167, 512, 136, VELOSTAT),
        (183, 520, 120, COPPER),
    ):
        d.box(left, top, width, 14, fill=color, round_=3)
    d.text(580, 226, "copper, Velostat, copper", size=13, color=DIM, anchor="middle")
    return d


def pin(d: Drawing, y: float, label: str) -> tuple[float, float]:
    """Write a pin of the Mega at a height; return where it is."""
    d.text(202, y + 4, label, size=13, anchor="end")
    return (210, y)


def matrix(
    d: Drawing, row_mux: dict[str, tuple[float, float]], col_mux: dict[str, tuple[float, float]]
) -> None:
    """Draw the pixels and their row and column lines."""
    left, top, pitch, side = 830, 130, 92, 56
    for finger in range(2):
        y = top - 16 + 2 * finger * (pitch + 12)
        d.box(left - 22, y, 234, 2 * pitch + 6, fill="#fafafa", stroke=DIM, round_=14, dash="5 4")
        d.text(left + 226, y + pitch + 6, f"finger {finger}", color=DIM, size=14)
    column_x = [left + side / 2 + pitch * col + 10 for col in range(2)]
    row_y = [top + side / 2 + row * pitch + 24 * (row // 2) for row in range(4)]
    for col in range(2):
        x, (start_x, start_y) = column_x[col], col_mux[f"C{col}"]
        bottom = 600 + 24 * col
        lane = start_x + 60 - 24 * col
        d.wire(
            (start_x, start_y), (lane, start_y), (lane, bottom), (x, bottom), (x, row_y[0]),
            color=COLS,
        )  # fmt: skip
        d.text(lane + 8, bottom - 6, f"column C{col}", size=12, color=COLS)
    for row in range(4):
        start_x, start_y = row_mux[f"R{row}"]
        lane = start_x + 110 - 22 * row
        d.wire(
            (start_x, start_y), (lane, start_y), (lane, row_y[row]), (column_x[1], row_y[row]),
            color=ROWS,
        )  # fmt: skip
        d.text(left - 26, row_y[row] - 7, f"row R{row}", size=12, color=ROWS, anchor="end")
        for col in range(2):
            x = column_x[col] - side / 2
            d.box(x, row_y[row] - side / 2, side, side, fill=VELOSTAT, stroke=COPPER, round_=8)
            d.text(column_x[col], row_y[row] + 4, f"R{row} C{col}", size=12, color=PAPER,
                   anchor="middle")  # fmt: skip


def power(
    d: Drawing, row_mux: dict[str, tuple[float, float]], col_mux: dict[str, tuple[float, float]]
) -> None:
    """Draw supply and ground, with the rows' common at the supply."""
    five, ground = pin(d, 173, "5V"), pin(d, 680, "GND")
    rail, earth = 430, 400
    d.wire(five, (rail, five[1]), (rail, col_mux["VCC"][1]), col_mux["VCC"], color=POWER)
    d.wire((rail, row_mux["VCC"][1]), row_mux["VCC"], color=POWER)
    d.wire((rail, row_mux["VCC"][1]), (rail, five[1]), color=POWER)
    d.wire((rail, row_mux["SIG"][1]), row_mux["SIG"], color=POWER)
    d.wire(ground, (earth, ground[1]), (earth, row_mux["EN"][1]), color=GROUND)
    for mux in (row_mux, col_mux):
        for name in ("EN", "GND"):
            d.wire((earth, mux[name][1]), mux[name], color=GROUND)
            d.dot(earth, mux[name][1], color=GROUND)
    d.dot(rail, row_mux["SIG"][1], color=POWER)
    d.dot(rail, five[1], color=POWER)


def selects(
    d: Drawing, mux: dict[str, tuple[float, float]], pins: tuple[str, ...], *, lane: float
) -> None:
    """Draw the four select lines of a multiplexer."""
    for k, label in enumerate(pins):
        end = mux[f"S{k}"]
        start = pin(d, end[1] + 46, label)
        turn = lane + 20 * (3 - k)
        d.wire(start, (turn, start[1]), (turn, end[1]), end, color=SELECT, width=1.8)


def divider(
    d: Drawing, row_mux: dict[str, tuple[float, float]], col_mux: dict[str, tuple[float, float]]
) -> None:
    """Draw the columns' common through 1 kΩ to A0, and the reference resistor to ground."""
    end = col_mux["SIG"]
    start = pin(d, end[1], "A0")
    d.wire(start, end, color=SIGNAL, width=2.6)
    d.box(236, end[1] - 9, 44, 18, fill=PAPER, stroke=INK)
    d.text(258, end[1] + 26, "1 kΩ", size=13, anchor="middle")
    x = 330
    d.wire((x, end[1]), (x, end[1] + 12), color=SIGNAL)
    d.box(x - 9, end[1] + 12, 18, 44, fill=PAPER, stroke=INK)
    d.wire((x, end[1] + 56), (x, 680), color=GROUND)
    d.dot(x, end[1], color=SIGNAL)
    d.dot(x, 680, color=GROUND)
    d.text(x - 18, end[1] + 54, "R ref 4.7 kΩ", size=13, anchor="end")


def legend(d: Drawing) -> None:
    """Name the colours, and say what the drawing leaves out."""
    for k, (color, words) in enumerate(
        (
            (POWER, "5 V"),
            (GROUND, "ground"),
            (SELECT, "select"),
            (ROWS, "row lines"),
            (COLS, "column lines"),
            (SIGNAL, "divider to converter"),
        )
    ):
        x = 470 + [0, 70, 160, 240, 345, 470][k]
        d.wire((x, 716), (x + 22, 716), color=color, width=4)
        d.text(x + 28, 721, words, size=13)
    d.text(470, 746, "100 nF from VCC to GND at each multiplexer.", size=13, color=DIM)


def layouts() -> Drawing:
    """Draw the two pixel layouts at one scale, and the layers."""
    d = Drawing(1180, 520, title="Pixel layouts and layers")
    d.text(40, 44, "Pixel layouts, to one scale, and the layers of a sensor", size=22, weight=700)
    sensor(d, 60, 110, rows=2, pixel_mm=7.0, name="rigid-2x2, one finger", note="8 pixels on two")
    sensor(d, 400, 110, rows=3, pixel_mm=9.0, name="soft-3x2, one finger", note="12 pixels on two")
    layers(d, 770, 130)
    return d


def sensor(
    d: Drawing, x: float, y: float, *, rows: int, pixel_mm: float, name: str, note: str
) -> None:
    """Draw one finger's array; 10 mm are 90 units."""
    scale, pitch_mm, cols = 9.0, 10.0, 2
    width, height = scale * (pitch_mm * cols + 4), scale * (pitch_mm * rows + 4)
    side, pitch = scale * pixel_mm, scale * pitch_mm
    strip = side - 2.0 * scale
    d.box(x, y, width, height, fill=TAPE, round_=10)
    centre_x = [x + width / 2 + pitch * (col - 0.5) for col in range(cols)]
    centre_y = [y + height / 2 + pitch * (row - (rows - 1) / 2) for row in range(rows)]
    for col in range(cols):
        d.box(centre_x[col] - strip / 2, y + 8, strip, height + 8, fill=COPPER, stroke="none")
        d.text(centre_x[col], y + height + 32, f"C{col}", anchor="middle", color=COLS, weight=700)
    for row in range(rows):
        d.box(x + 8, centre_y[row] - strip / 2, width + 8, strip, fill=COPPER, stroke="none")
        d.text(x + width + 22, centre_y[row] + 5, f"R{row}", color=ROWS, weight=700)
        for col in range(cols):
            d.box(centre_x[col] - side / 2, centre_y[row] - side / 2, side, side, fill=VELOSTAT,
                  round_=6)  # fmt: skip
    d.text(centre_x[0], centre_y[0] + 5, f"{pixel_mm:g} mm", color=PAPER, anchor="middle", size=13)
    d.text(x, y - 30, name, weight=700)
    d.text(x, y - 11, f"{note} fingers, pitch {pitch_mm:g} mm", size=13, color=DIM)


def layers(d: Drawing, x: float, y: float) -> None:
    """Draw the layers, pulled apart."""
    stack = (
        ("cover tape", TAPE, ((0, 260),)),
        ("copper columns", COPPER, ((40, 70), (150, 70))),
        ("Velostat pixels", VELOSTAT, ((32, 86), (142, 86))),
        ("copper rows", COPPER, ((14, 232),)),
        ("base tape, on the finger's pad", TAPE, ((0, 260),)),
    )
    d.text(x, y - 50, "Layers, pulled apart", weight=700)
    d.text(x, y - 31, "load from above", size=13, color=DIM)
    for k, (name, color, pieces) in enumerate(stack):
        top = y + 62 * k
        for start, width in pieces:
            d.box(x + start, top, width, 20, fill=color, round_=3)
        d.text(x, top + 38, name, size=13)


if __name__ == "__main__":
    wiring().save(HERE / "wiring.svg")
    one_pad().save(HERE / "one_pad.svg")
    layouts().save(HERE / "layouts.svg")
