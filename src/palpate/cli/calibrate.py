"""`palpate calibrate STEP`: create or update a part of the calibration file."""

from __future__ import annotations

_HERE = "palpate.cli"
#: Step -> (module:function, summary).
calibrate = {
    "rest": (
        f"{_HERE}.calibrate_rest:calibrate_rest",
        "Rest resistance of each pixel, without load",
    ),
    "force": (
        f"{_HERE}.calibrate_force:calibrate_force",
        "Force law, from a load cell or dead weights",
    ),
    "compliance": (
        f"{_HERE}.calibrate_compliance:calibrate_compliance",
        "Compliance of pads, fingers and servo",
    ),
    "cell": (f"{_HERE}.calibrate_force:calibrate_cell", "Newtons per count of a board's load cell"),
    "damage": (
        f"{_HERE}.calibrate_damage:calibrate_damage",
        "Damage limit of produce, from rupture tests",
    ),
    "settling": (
        f"{_HERE}.calibrate_settling:calibrate_settling",
        "Settled holds for `settle --learn-from`, from recordings",
    ),
}
