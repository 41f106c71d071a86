"""`palpate calibrate force`: newtons, from a load cell or from dead weights."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import typer
from rich.console import Console
from rich.progress import Progress

from palpate.cli import options as option
from palpate.cli.calibrate_bench import (
    ask_user,
    calibration_file,
    earlier_calibration,
    has_load_cell,
    new_calibration,
    now_text,
    open_bench,
)
from palpate.cli.calibrate_weights import weigh_loads
from palpate.cli.output import print_json
from palpate.grasp.calibrating import HOLDS_N, measure_force, measure_rest
from palpate.grasp.paper_method import with_line_law
from palpate.grasp.planning import DWELL_S, HORIZON_S, with_force_law
from palpate.plots.force_calibration import force_calibration_figure
from palpate.plots.style import check_plot, save_figure
from palpate.sensor.calibration import Calibration


def force(
    rig: option.RigOption = "",
    loads: Annotated[
        Path | None,
        typer.Option(
            help="Dead weights in order, such as 1.5, 4, 9 N: column load_n.", metavar="CSV"
        ),
    ] = None,
    tolerance_percent: Annotated[
        float,
        typer.Option(
            "--tolerance",
            help="Dead weights: half interval, percent, at which no more are asked for.",
            min=0.0,
            metavar="PERCENT",
        ),
    ] = 0.0,
    out: option.CalibrationOption = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw readings and law.", metavar="FILE")
    ] = None,
    dpi: option.DpiOption = None,
    law: Annotated[
        Literal["power", "line"],
        typer.Option(help="line: the paper's, from the mean relative change (Table 4)."),
    ] = "power",
    seed: option.SeedOption = 0,
    temperature_c: option.TemperatureOption = None,
    humidity_percent: option.HumidityOption = None,
    as_json: option.JsonOption = False,
) -> None:
    """Calibrate the force: guided steps up and down, a held-out check, and a verdict.

    With a load cell: --rig sim-rigid, or a rig file with [load_cells]. Without one, lay three or
    more dead weights on the pad, spread over the range; each is asked for, or give --loads.

    Example: palpate calibrate force --rig sim-rigid --seed 3 --out pad-3.json
    """
    path = calibration_file(rig, out)
    check_plot(plot, dpi=dpi)
    if loads is None and has_load_cell(rig):
        made, course = _calibrate_by_cell(rig, seed=seed, out=path), None
    else:
        made, course = weigh_loads(rig, loads=loads, out=path, tolerance_percent=tolerance_percent)
    made = replace(
        made,
        temperature_c=made.temperature_c if temperature_c is None else temperature_c,
        humidity_percent=made.humidity_percent if humidity_percent is None else humidity_percent,
    )
    if law == "line":
        made = with_line_law(made)
    made.save(path)
    if plot is not None:
        save_figure(force_calibration_figure(made), plot, dpi=dpi)
    if as_json:
        document = _document(made, path=path)
        if course is not None:
            document["half_interval_percent"] = course.to_dict()
        print_json(document)
    else:
        _print(made, path=path)
        if plot is not None:
            print(f"Written: {plot}")


class _Shown:
    """A bar of placements on standard error, which gives way to questions."""

    def __init__(self, placements: int) -> None:
        self._bar = Progress(console=Console(stderr=True), transient=True)
        self._task = self._bar.add_task("settled holds", total=placements)

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def ask(self, what: str) -> None:
        """Ask for something to be done, and wait; a bar that is redrawn would wipe that out."""
        self._bar.stop()
        ask_user(what)
        self._bar.start()

    def show(self, what: str, *, advance: int = 0) -> None:
        """Show what is being done, and by how many placements the work has advanced."""
        self._bar.update(self._task, description=what, advance=advance)


def _calibrate_by_cell(rig: str, *, seed: int, out: Path) -> Calibration:
    """Read settled holds on the load cell and fit the laws of a grasp to them."""
    shown = _Shown(len(HOLDS_N))
    with open_bench(rig, seed=seed, ask=shown.ask, placements=len(HOLDS_N)) as guided, shown:
        bench, layout = guided.bench, guided.bench.array.layout
        earlier = earlier_calibration(out, layout=layout, simulated=guided.simulated)

        def placed(run: int) -> None:
            shown.show(f"settled holds, placement {run + 1}", advance=1)
            guided.reseat(run)

        rest = measure_rest(bench)
        pairs = measure_force(
            bench,
            holds_n=HOLDS_N,
            reseat=placed,
            dwell_s=DWELL_S,
            horizon_s=HORIZON_S,
        )
        begin = earlier or new_calibration(layout, rest=rest, simulated=guided.simulated)
    made = with_force_law(replace(begin, rest=rest, force=pairs))
    return replace(made, made_at=now_text())


def _document(made: Calibration, *, path: Path) -> dict[str, Any]:
    return {
        "file": str(path),
        "simulated": made.origin == "simulated",
        "pairs": len(made.force.force_n),
        "force_law": made.force_law,
        "hysteresis_seen": _find_hysteresis(made),
        "expected_error_percent": made.held_out.get("error_percent", {}),
        "expected_early_error_percent": made.held_out.get("early_error_percent", {}),
        "expected_error_of": made.held_out.get("of"),
    }


def _find_hysteresis(made: Calibration) -> bool:
    return bool(made.held_out.get("unloading_seen", False))


def _print(made: Calibration, *, path: Path) -> None:
    simulated = " (simulated)" if made.origin == "simulated" else ""
    law = made.force_law["law"]
    print(f"{path}{simulated}: force law {law}, {len(made.force.force_n)} pairs")
    seen = "seen and learned" if _find_hysteresis(made) else "not seen: left out"
    print(f"hysteresis: {seen}")
    print(f"expected error of {made.held_out['of']}, on placements or loads left out of the fit:")
    early = made.held_out.get("early_error_percent", {})
    for force, error in made.held_out["error_percent"].items():
        soon = f", {_percent(early[force])} soon after a movement" if force in early else ""
        print(f"  {force.removesuffix('_n'):>4} N  {_percent(error)}{soon}")


def _percent(error: float | None) -> str:
    return "not reached: out of range" if error is None else f"{error:.0f} %"
