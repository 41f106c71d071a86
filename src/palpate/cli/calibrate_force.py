"""`palpate calibrate force` and `cell`: force law, and scale of the load cells."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer

from palpate.calibrate.dead_weights import (
    MIN_LOADS,
    SPREAD_N,
    check_loads,
    half_widths_percent,
    has_unloading,
    measure_loads,
    parse_load,
    read_loads,
)
from palpate.calibrate.force_law import add_force_law, add_line_law
from palpate.calibrate.guided import HOLDS_N, measure_force, measure_rest
from palpate.calibrate.rest import format_now, replace_rest
from palpate.calibration import Calibration, ForcePairs
from palpate.cli import options as option
from palpate.cli.calibrate_bench import (
    has_load_cell,
    load_earlier_calibration,
    open_bench,
    prompt_user,
    resolve_calibration_file,
)
from palpate.cli.options import JsonOption, opt
from palpate.cli.output import print_json, print_message, progress
from palpate.cli.sensor_source import open_source
from palpate.clock import RealClock
from palpate.errors import CalibrationError, InputError
from palpate.force.of_calibration import DWELL_S, HORIZON_S, settled_pairs
from palpate.plots.force_calibration import force_calibration_figure
from palpate.plots.style import check_plot, save_figure
from palpate.rig.board_cell import measure_mean_counts, require_board
from palpate.rig.file import read_load_cells
from palpate.rig.guard_limit import explain_stop, find_stop
from palpate.sensor.array import ArrayLayout

#: Limit of a guard whose stop is reported as an example, newtons.
_GUARD_N = 3.0
#: Ranges from which a weight is proposed, newtons, around those of `SPREAD_N`.
_RANGES_N = ((1.0, 2.5), (2.5, 6.0), (6.0, 12.0))


def calibrate_force(
    rig: option.RigOption = "",
    loads: Annotated[
        Path | None,
        opt("--loads CSV", "Table of dead weights in order, such as 1.5, 4, 9 N: column load_n."),
    ] = None,
    tolerance_percent: Annotated[
        float,
        opt(
            "--tolerance PERCENT",
            "Dead weights: stop when the half-width of the intervals is below this.",
            min=0.0,
        ),
    ] = 0.0,
    out: option.CalibrationOption = None,
    plot: option.PlotOption = None,
    law: Annotated[
        Literal["power", "line"],
        opt("--law", "line: the paper's law from the mean relative change (Table 4)."),
    ] = "power",
    seed: option.SeedOption = 0,
    as_json: option.JsonOption = False,
) -> None:
    """Calibrate the force, and report the expected error.

    With a load cell, use --rig sim-rigid or a rig file with [load_cells]. Without a load cell,
    place at least three dead weights on the pad, spread over the range; the command prompts for
    each weight, or reads the list given by --loads.

    Example: palpate calibrate force --rig sim-rigid --seed 3 --out pad-3.json
    """
    path = resolve_calibration_file(rig, out)
    check_plot(plot)
    if loads is None and has_load_cell(rig):
        calibration, series = _calibrate_by_cell(rig, seed=seed, out=path), None
    else:
        calibration, series = _weigh_loads(
            rig, loads=loads, out=path, tolerance_percent=tolerance_percent
        )
    if law == "line":
        calibration = add_line_law(calibration)
    calibration.save(path)
    if plot is not None:
        save_figure(force_calibration_figure(calibration), plot)
    if as_json:
        document = _document(calibration, path=path)
        if series is not None:
            document["half_interval_percent"] = {
                f"{force}_n": width for force, width in series.half_widths_percent.items()
            }
        print_json(document)
    else:
        _print(calibration, path=path)
        if plot is not None:
            print(f"Written: {plot}")


def _calibrate_by_cell(rig: str, *, seed: int, out: Path) -> Calibration:
    """Measure settled holds on the load cell and fit the force law."""
    placements = len(HOLDS_N)
    with (
        open_bench(rig, seed=seed, placements=placements) as guided,
        # Redrawing a progress bar would erase the prompts.
        progress("settled holds", total=placements, quiet=not guided.is_simulated) as show,
    ):
        bench, layout = guided.bench, guided.bench.array.layout
        earlier = load_earlier_calibration(out, layout=layout, simulated=guided.is_simulated)

        def reseat(run: int) -> None:
            show(run + 1)
            guided.reseat(run)

        rest = measure_rest(bench)
        pairs = measure_force(
            bench,
            holds_n=HOLDS_N,
            reseat=reseat,
            dwell_s=DWELL_S,
            horizon_s=HORIZON_S,
        )
        base = replace_rest(earlier, rest, layout=layout, simulated=guided.is_simulated)
    calibration = add_force_law(replace(base, force=pairs))
    return replace(calibration, made_at=format_now())


def _document(calibration: Calibration, *, path: Path) -> dict[str, Any]:
    return {
        "file": str(path),
        "simulated": calibration.origin == "simulated",
        "pairs": len(calibration.force.force_n),
        "force_law": calibration.force_law,
        "hysteresis_seen": bool(calibration.held_out.get("unloading_seen", False)),
        "expected_error_percent": calibration.held_out.get("error_percent", {}),
        "expected_early_error_percent": calibration.held_out.get("early_error_percent", {}),
        "expected_error_of": calibration.held_out.get("of"),
    }


def _print(calibration: Calibration, *, path: Path) -> None:
    simulated = " (simulated)" if calibration.origin == "simulated" else ""
    law = calibration.force_law["law"]
    print(f"{path}{simulated}: force law {law}, {len(calibration.force.force_n)} pairs")
    print(f"expected error of {calibration.held_out['of']}, on held-out placements or loads:")
    early = calibration.held_out.get("early_error_percent", {})
    for force, error in calibration.held_out["error_percent"].items():
        soon = f", {_percent(early[force])} shortly after a movement" if force in early else ""
        print(f"  {force.removesuffix('_n'):>4} N  {_percent(error)}{soon}")
    stop = find_stop(calibration, limit_n=_GUARD_N)
    if text := explain_stop(stop, limit_n=_GUARD_N, calibration=calibration):
        print(text)


def _percent(error: float | None) -> str:
    if error is None:
        return "not measured: out of range"
    return f"{error:.0f} %" if error >= 1.0 else "below 1 %"


class WeightSeries:
    """The half-widths of the force's intervals after each dead weight.

    `layout`: of the sensor.
    `tolerance_percent`: half-width at 1.5, 4 and 9 N below which no further weight is requested;
    0 requests every weight.
    """

    def __init__(self, *, layout: ArrayLayout, tolerance_percent: float) -> None:
        self._layout, self._tolerance_percent = layout, tolerance_percent
        self._loads_n: tuple[float, ...] = ()
        #: By force in newtons, percent of it; empty before the first weight.
        self.half_widths_percent: dict[str, float] = {}

    @property
    def is_within_tolerance(self) -> bool:
        """Whether at least three weights were added and all intervals are within the tolerance."""
        if len(self._loads_n) < MIN_LOADS:
            return False
        return max(self.half_widths_percent.values()) <= self._tolerance_percent

    @property
    def next_range(self) -> str:
        """The range whose usual load is furthest from those so far, in newtons and grams."""
        known = np.log(np.array(self._loads_n))
        distance = [np.min(np.abs(np.log(one) - known), initial=np.inf) for one in SPREAD_N]
        low_n, high_n = _RANGES_N[int(np.argmax(distance))]
        return f"{low_n:g} to {high_n:g} N ({100 * low_n:g} to {100 * high_n:g} g)"

    def add(self, pairs: ForcePairs) -> None:
        """Take all pairs so far, and print the new half-widths."""
        self._loads_n = settled_pairs(pairs).force_n
        self.half_widths_percent = half_widths_percent(pairs, layout=self._layout)
        each = ", ".join(
            f"{width:.0f} % at {force} N" for force, width in self.half_widths_percent.items()
        )
        advice = (
            "within the tolerance"
            if self.is_within_tolerance
            else f"most useful next: {self.next_range}"
        )
        print_message(
            f"{pairs.force_n[-1]:.4g} N measured; half-width of the interval: {each}; {advice}"
        )


def _weigh_loads(
    rig: str, *, loads: Path | None, out: Path, tolerance_percent: float
) -> tuple[Calibration, WeightSeries]:
    """Measure dead weights as the user places them, and fit the force law.

    Raises `InputError` if the rig is simulated, the loads are insufficient for a calibration, or
    `out` does not exist.
    """
    if rig.startswith("sim-"):
        without = "" if loads is None else "; omit --loads"
        raise InputError(
            f"rig {rig!r} is simulated and can't be loaded with weights{without} "
            "(--rig sim-rigid has a load cell)"
        )
    listed = None if loads is None else read_loads(loads)
    with closing(open_source(rig=rig)) as source:
        series = WeightSeries(layout=source.array.layout, tolerance_percent=tolerance_percent)
        earlier = load_earlier_calibration(
            out, layout=source.array.layout, simulated=source.simulated
        )
        if earlier is None:
            raise InputError(
                f"{out} does not exist yet; run `palpate calibrate rest --rig {rig} --out {out}`"
            )

        def place(load_n: float) -> None:
            if listed is not None:
                prompt_user(f"place {load_n:.4g} N on the pad, then press Enter")

        print_message(f"{source.name}: do not touch the sensor until the first request")
        weighing = measure_loads(
            source.array,
            loads_n=_prompt_for_loads(series)
            if listed is None
            else _iterate_until_tolerance(listed, series),
            place=place,
            clock=RealClock(),
            settled=series.add,
            tell=print_message,
        )
    calibration = add_force_law(replace(earlier, force=weighing.pairs))
    held_out = {
        **calibration.held_out,
        "unloading_seen": has_unloading(weighing.pairs.force_n),
    }
    return replace(calibration, held_out=held_out, made_at=format_now()), series


def _iterate_until_tolerance(loads_n: Sequence[float], series: WeightSeries) -> Iterator[float]:
    for load_n in loads_n:
        if series.is_within_tolerance:
            return
        yield load_n


def _prompt_for_loads(series: WeightSeries) -> Iterator[float]:
    """Prompt for weights, suggesting the most useful one, until an empty line."""
    loads_n: list[float] = []
    while not series.is_within_tolerance:
        ask = (
            f"place a weight of {series.next_range} on the pad, or another one that you have; type "
            "it, such as 250 g or 2.45 for newtons, then wait 20 s (Enter: done)"
        )
        typed = str(typer.prompt(ask, default="", err=True, show_default=False)).strip()
        if not typed:
            break
        try:
            loads_n.append(parse_load(typed))
        except InputError as error:
            print_message(str(error))
        else:
            print_message(f"{typed}: {loads_n[-1]:.4g} N; do not touch the weight")
            yield loads_n[-1]
    check_loads(loads_n, where="the weights")


#: Minimum change, counts: a 1 kg, 1 mV/V cell on an HX711 at gain 128 changes by about 200 000
#: counts per newton.
_MIN_COUNTS = 1000.0


def calibrate_cell(
    rig: Annotated[str, opt("--rig TOML", "Rig file of a board.")],
    known_n: Annotated[float, opt("--known-n NEWTONS", "Known weight, newtons (kg * 9.81).")],
    cell: Annotated[int, opt("--cell N", "Load cell of the board, 0 or 1.", min=0, max=1)] = 0,
    as_json: JsonOption = False,
) -> None:
    """Measure a known weight on a load cell; print the rig-file table.

    Example: palpate calibrate cell --rig rig.toml --cell 0 --known-n 9.81
    """
    if not (math.isfinite(known_n) and known_n > 0):
        raise InputError(f"--known-n must be above 0 newtons, not {known_n:g}")
    if not rig.endswith(".toml"):
        raise InputError(f"rig {rig!r} is simulated; give the rig file of a board")
    known = read_load_cells(Path(rig)) or ()
    if cell > len(known):
        raise InputError(
            f"--cell {cell}: calibrate cell 0 first and copy the printed [load_cells] into {rig}"
        )
    clock = RealClock()
    with closing(open_source(rig=rig)) as source:
        board = require_board(source.array)
        prompt_user(f"remove everything from load cell {cell}, then press Enter")
        (empty,) = measure_mean_counts(board, cells=(cell,), clock=clock)
        prompt_user(
            f"place {known_n:g} N on load cell {cell}, wait until it is still, then press Enter"
        )
        (loaded,) = measure_mean_counts(board, cells=(cell,), clock=clock)
    if abs(loaded - empty) < _MIN_COUNTS:
        raise CalibrationError(
            f"load cell {cell} changed by only {loaded - empty:.0f} counts; check that the weight "
            "is on this cell, or give another --cell"
        )
    scales = [*known[:cell], known_n / (loaded - empty), *known[cell + 1 :]]
    if as_json:
        print_json({"rig": rig, "cell": cell, "newtons_per_count": scales})
        return
    print("[load_cells]")
    print(f"newtons_per_count = [{', '.join(f'{scale:.6g}' for scale in scales)}]")
