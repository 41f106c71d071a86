"""Codes of the findings of a health check, each with its remedy."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Severity(StrEnum):
    """Severity of a finding: a fault makes the sensor unhealthy, advice does not."""

    FAULT = "fault"
    ADVICE = "advice"


#: A sensor without a conductance at rest gets one.
FSR_AT_REST = (
    "an FSR conducts nothing at rest: solder a resistor of about five times the reference resistor "
    "across it"
)
#: Remedy of each code. `docs/troubleshooting.md` lists the codes with their conditions.
CHECKS: dict[str, str] = {
    "open": "check the solder joint and the copper under the pixel; a whole row or column points "
    "to its wire or multiplexer channel, every pixel to the supply, the reference resistor or a "
    f"multiplexer's enable pin; {FSR_AT_REST}",
    "short": "look for copper that touches through a hole or at the edge of the Velostat, and for "
    "solder bridges; every pixel points to a missing reference resistor, or to the "
    "wrong `taxel_leg` in the rig file",
    "loose": "move the wire and the connector while `palpate live` runs; solder the joint that "
    "makes it jump",
    "stuck": "press that pixel in `palpate live`; if its reading does not change, look for a "
    "broken select line of the multiplexer or a wire soldered to a fixed voltage",
    "noisy": "shorten or twist the wires, keep them away from motors and mains, connect all "
    "grounds; a single noisy pixel has a poor joint, and oversampling only hides it",
    "drifting": "look for moisture, lifting tape or a cable under tension; after a press, a sheet "
    "needs a few minutes of rest",
    "faint": "the pixel has poor contact or its tape has lifted: press the layers together; if "
    "that helps, renew the tape",
    "changed": "the pixel has aged or was damaged since the calibration: run `palpate calibrate "
    "rest`, and replace the sheet if it keeps changing",
    "unrest": "open the fingers, remove any object from the sensor, wait a minute and repeat",
    "leg": "press a pixel in `palpate live`: if its resistance rises, enter the other part of the "
    "divider in the rig file (`taxel_leg`), and calibrate again",
    "resistor": "replace the reference resistor, enter the new value in the rig file, and "
    "calibrate again",
    "swapped": "exchange the two wires, or their pins at the multiplexer",
    "silent": "press the pixel harder and in its middle; if it still does not respond, treat it as "
    "open: joint, copper, multiplexer channel",
    "slow": "lower the rate or the oversampling; check with `palpate ports` that this is the "
    "right board",
    "lost": "use a shorter USB cable and no hub, and close other programs that load the machine; "
    "at 9600 baud set at most 15 Hz",
    "corrupt": "check cable and ground; another program on the port or a wrong baud rate has the "
    "same effect",
    "latency": "set the adapter's latency timer to 1 ms; a udev rule keeps the setting",
    "late": "the computer stalls: close busy programs, or lower the rate",
    "jitter": "another task delays the board or the link; times remain correct, but filters that "
    "assume evenly spaced frames are affected",
    "clock": "the board's resonator is out of tolerance, or the computer's clock is being "
    "adjusted: repeat, then try another board",
    "restarted": "the board reset itself or was unplugged: check its supply, especially if the "
    "gripper's motor shares it",
}


@dataclass(frozen=True, slots=True)
class Finding:
    """One fault or one recommendation.

    >>> found = Finding("late", "7 frames late", severity=Severity.ADVICE)
    >>> found.check
    'the computer stalls: close busy programs, or lower the rate'
    """

    #: A key of `CHECKS`.
    code: str
    #: The measurement, with its numbers.
    text: str
    #: The affected pixel ("R0 C1"), line ("row R0") or part.
    where: str = "link"
    #: Fault or advice.
    severity: Severity = Severity.FAULT

    @property
    def check(self) -> str:
        """Remedy for the fault, or reason for the recommendation."""
        return CHECKS[self.code]

    def affects_pixel(self, row: int, col: int) -> bool:
        """Return whether the finding affects a pixel, its row or column, or all pixels."""
        return self.where in (
            pixel_name(row, col),
            f"row R{row}",
            f"column C{col}",
            "every pixel",
        )


def pixel_name(row: int, col: int) -> str:
    """Return the name of a pixel from the multiplexer channels of its row and column.

    >>> pixel_name(0, 1)
    'R0 C1'
    """
    return f"R{row} C{col}"
