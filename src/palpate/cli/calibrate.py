"""`palpate calibrate STEP`: make or renew a part of the calibration file."""

from __future__ import annotations

_HERE = "palpate.cli"
#: Step -> where it is, and what it does.
calibrate = {
    "rest": (f"{_HERE}.calibrate_rest:rest", "What each pixel reads with nothing on it"),
    "force": (f"{_HERE}.calibrate_force:force", "Newtons: a load cell, or weights, up and down"),
    "compliance": (
        f"{_HERE}.calibrate_compliance:compliance",
        "How far pads, fingers and servo deflect",
    ),
    "cell": (f"{_HERE}.calibrate_force:cell", "Newtons per count of the board's load cell"),
    "damage": (f"{_HERE}.calibrate_damage:damage", "The force that produce withstands"),
    "settling": (
        f"{_HERE}.calibrate_settling:settling",
        "Holds for `settle --learn-from`, from recordings",
    ),
}
