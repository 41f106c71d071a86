"""Dead weights, one after the other: what each narrows, and which to lay on next."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import typer

from palpate.cli.calibrate_bench import ask_user, earlier_calibration, now_text
from palpate.cli.sensor_source import open_source
from palpate.clock import RealClock
from palpate.errors import InputError
from palpate.estimate.force_follower import SPREAD_N, half_width_percent, most_useful_n
from palpate.estimate.force_law import ForceLaw
from palpate.grasp.planning import with_force_law
from palpate.sensor.calibration import Calibration
from palpate.sensor.dead_weights import (
    FEWEST,
    check_loads,
    hysteresis_seen,
    read_loads,
    weigh,
)


class Course:
    """The law after each weight, and what is left of its intervals.

    `tolerance_percent`: half of the interval at 1.5, 4 and 9 N at which no more is asked for; 0
    asks for every weight.
    """

    def __init__(self, *, tolerance_percent: float) -> None:
        self._tolerance_percent = tolerance_percent
        self._law = ForceLaw()
        self._known: list[tuple[float, float]] = []
        self.before = self.after = self._half_widths()

    @property
    def enough(self) -> bool:
        """Whether the intervals are within the tolerance, after at least three weights."""
        return self._law.known >= FEWEST and max(self.after.values()) <= self._tolerance_percent

    @property
    def next_n(self) -> float:
        """The load that would narrow the intervals most."""
        return most_useful_n(self._law)

    def take(self, excess: float, load_n: float) -> None:
        """Take a settled reading, and print what it narrowed."""
        self._known.append((excess, load_n))
        readings, loads_n = zip(*self._known, strict=True)
        self._law = ForceLaw.fit(readings, force_n=loads_n)
        last, self.after = self.after, self._half_widths()
        each = ", ".join(
            f"{force} N {last[force]:.0f} to {self.after[force]:.0f} %" for force in self.after
        )
        advice = "within the tolerance" if self.enough else f"most would show {self.next_n:g} N"
        print(f"{load_n:g} N: half intervals at {each}; {advice}", file=sys.stderr)

    def to_dict(self) -> dict[str, dict[str, float]]:
        """Return half of the interval at each force before and after the weights, percent."""
        return {
            f"{force}_n": {"before": self.before[force], "after": self.after[force]}
            for force in self.before
        }

    def _half_widths(self) -> dict[str, float]:
        return {f"{at_n:g}": half_width_percent(self._law, at_n) for at_n in SPREAD_N}


def weigh_loads(
    rig: str, *, loads: Path | None, out: Path, tolerance_percent: float
) -> tuple[Calibration, Course]:
    """Read dead weights as the user lays them down, and fit the law to them.

    Raises `InputError` if the rig is simulated, the loads can't carry a calibration, or `out` is
    not there yet.
    """
    if rig.startswith("sim-"):
        without = "" if loads is None else "; leave --loads out"
        raise InputError(
            f"rig {rig!r} is simulated, and no weights can be laid on it{without} "
            "(--rig sim-rigid has a load cell)"
        )
    listed = None if loads is None else read_loads(loads)
    course = Course(tolerance_percent=tolerance_percent)
    with closing(open_source(rig=rig)) as source:
        earlier = earlier_calibration(out, layout=source.array.layout, simulated=source.simulated)
        if earlier is None:
            raise InputError(
                f"{out} is not there yet; run `palpate calibrate rest --rig {rig} --out {out}`"
            )

        def place(load_n: float) -> None:
            if listed is not None:
                ask_user(f"lay {load_n:g} N on the pad, then Enter")

        weighing = weigh(
            source.array,
            loads_n=_ask_loads(course) if listed is None else _until_enough(listed, course),
            place=place,
            clock=RealClock(),
            settled=course.take,
        )
    for load_n in weighing.refused_n:
        print(f"refused: {load_n:g} N did not settle", file=sys.stderr)
    made = with_force_law(replace(earlier, force=weighing.pairs))
    held_out = {
        **made.held_out,
        "unloading_seen": hysteresis_seen(weighing.pairs.force_n),
    }
    return replace(made, held_out=held_out, made_at=now_text()), course


def _until_enough(loads_n: Sequence[float], course: Course) -> Iterator[float]:
    for load_n in loads_n:
        if course.enough:
            return
        yield load_n


def _ask_loads(course: Course) -> Iterator[float]:
    """Ask for one weight after the other, the most useful one first, until Enter alone."""
    loads_n: list[float] = []
    while not course.enough:
        ask = f"lay a weight near {course.next_n:g} N on the pad and type its newtons (Enter ends)"
        typed = str(typer.prompt(ask, default="", err=True, show_default=False)).strip()
        if not typed:
            break
        try:
            loads_n.append(float(typed))
        except ValueError as error:
            raise InputError(f"load {typed!r}: type newtons, such as 4.0") from error
        yield loads_n[-1]
    check_loads(loads_n, where="the weights")
