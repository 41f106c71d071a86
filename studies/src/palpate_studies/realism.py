"""Whether the twin is kinder than real recordings: scatter, creep, shapes and noise."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from palpate.arrays import FloatArray
from palpate.holds import read_holds
from palpate_studies.force_ladders import read_ladders
from palpate_studies.press_data import read_presses
from palpate_studies.realism_quantities import (
    SMALLEST_N,
    halves,
    hold_quantities,
    ladder_quantities,
    log_gains,
    press_quantities,
    together,
)
from palpate_studies.realism_twin import twin_ladder, twin_presses, twin_weights
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS

SENSORS, PRESSES, HOLDS = 12, 8, 3
#: Quantity -> its meaning. A smaller value on the twin than on the recordings is the kinder one.
MEANING = {
    "exponent": "of excess conductance in force, sensor by sensor (standard deviation compared)",
    "scatter of ln force": "about the sensor's own power law, every weight placed again",
    "ln force missed": "by the power law of two other sensors",
    "gain scatter": "sd of ln conductance at equal force, place to place",
    "gain scatter, eight places": "pressed together",
    "gain from eight places to the next": "difference / sqrt 2 of half sheets",
    "creep, %": "of conductance within 1 s of the plateau, the force's share taken out",
    "still to come, %": "of the settled ohm value at 2.5 s",
    "noise, %": "of one sample on a settled hold",
    "relaxation error, %": "at 2.5 s, of the settled ohm value",
    "relaxation error, % of rest": "of the change still to come",
    "exponential error, %": "at 2.5 s, of the settled ohm value",
    "exponential error, % of rest": "of the change still to come",
}
Quantities = Mapping[str, FloatArray]


def report(
    *,
    ladders: Annotated[Path, typer.Option(help="Real ladders of weights.", metavar="CSV")],
    presses: Annotated[Path, typer.Option(help="Real presses with a load cell.", metavar="CSV")],
    holds: Annotated[Path, typer.Option(help="Real holds in ohm.", metavar="FILE")],
    sensors: int = SENSORS,
) -> StudyReport:
    """Compare the twin's scatter, creep, shapes and noise with those of real recordings.

    Example: palpate study realism --ladders ladders.csv --presses presses.csv.gz --holds holds.csv
    """
    real = real_quantities(ladders=ladders, presses=presses, holds=holds)
    twin = {level: twin_quantities(level=level, sensors=sensors) for level in LEVELS}
    rows = [
        compare(quantity, real[quantity], {level: twin[level][quantity] for level in LEVELS})
        for quantity in MEANING
    ]
    return StudyReport(
        name="realism",
        title="The twin compared with real recordings",
        provenance=[
            f"Simulated: {sensors} sensors of each level, {PRESSES} presses and {HOLDS} holds of "
            "each, read with 16 bit so that the converter adds nothing. Real: the files named.",
            "The ranges of `field` were set by this comparison, so agreement is no evidence for an "
            "estimator. `lab` scatters as the paper's Tables 2 to 6 do.",
            "Real places keep their gain from one press to the next. The twin draws its places "
            "again for each grasp, so its half sheets are eight places placed again.",
            "Kinder: the twin's median (or sd) is below the bootstrap 90 % interval of the real.",
        ],
        tables=[
            Table.of(
                "Value compared (10 to 90 %)",
                rows,
                {
                    "quantity": lambda row: f"{row['quantity']}: {MEANING[row['quantity']]}",
                    "n": "{n}",
                    "real": "{real}",
                    **{level: f"{{{level}}}" for level in LEVELS},
                },
            )
        ],
        payload={"study": "realism", "origin": "twin", "compared": rows},
    )


command = as_command(report)


def compare(quantity: str, real: FloatArray, twin: Quantities) -> dict[str, Any]:
    """Return a quantity of real recordings and of the twin; kinder is below the real interval."""
    of = np.nanstd if quantity == "exponent" else np.nanmedian
    drawn = np.random.default_rng(0).choice(real, size=(2000, real.size))
    lowest = float(np.quantile(of(drawn, axis=1), 0.05))

    def cell(values: FloatArray) -> str:
        low, high = np.nanquantile(values, [0.1, 0.9])
        return f"{of(values):.3g} ({low:.3g} to {high:.3g})"

    kinder = {level: bool(of(values) < lowest) for level, values in twin.items()}
    return {
        "quantity": quantity,
        "n": real.size,
        "real": cell(real),
        **{level: cell(twin[level]) + ", kinder" * kinder[level] for level in twin},
        "kinder": kinder,
    }


def real_quantities(*, ladders: Path, presses: Path, holds: Path) -> Quantities:
    """Return the quantities of real recordings."""
    pressed = read_presses(presses)
    gains = log_gains(pressed)
    return {
        **ladder_quantities(
            [
                (one.load_n[loaded], one.rest_ohm / one.resistance_ohm[loaded] - 1.0)
                for one in read_ladders(ladders)
                for loaded in [one.load_n > SMALLEST_N]
            ]
        ),
        **press_quantities(pressed),
        "gain scatter, eight places": together(gains),
        "gain from eight places to the next": halves(gains),
        **hold_quantities(read_holds(holds)),
    }


def twin_quantities(*, level: str, sensors: int = SENSORS) -> Quantities:
    """Return the same quantities of the twin."""
    pressed = [twin_presses(sensor, level=level, count=PRESSES) for sensor in range(sensors)]
    one, summed = ([p for pair in pressed for p in pair[part]] for part in (0, 1))
    gains = np.array(list(log_gains(summed).values()))
    return {
        **ladder_quantities([twin_ladder(sensor, level=level) for sensor in range(sensors)]),
        **press_quantities(one),
        "gain scatter, eight places": np.std(gains, axis=1, ddof=1),
        "gain from eight places to the next": np.abs(np.diff(gains, axis=1)).ravel() / np.sqrt(2),
        **hold_quantities(
            [h for sensor in range(sensors) for h in twin_weights(sensor, level=level, count=HOLDS)]
        ),
    }
