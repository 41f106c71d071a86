"""`palpate study NAME` and `palpate bench NAME`: run an installed study or benchmark."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Annotated, Any, Literal, TypeAlias

import typer

from palpate.cli.lazy_group import HELP, LazyCommand, LazyGroup, load_command
from palpate.cli.options import QuietOption
from palpate.cli.output import progress
from palpate.errors import InputError
from palpate.plots.style import PLOT_ENDINGS
from palpate_studies.report import FIGURE_FILES

FigureFormat: TypeAlias = Literal["pdf", "svg", "png"]
#: The benchmark that runs without a name.
ALL = "all"
#: The study parses the arguments after its name.
SETTINGS: dict[str, Any] = {
    "context_settings": {
        "allow_extra_args": True,
        "ignore_unknown_options": True,
        "help_option_names": [],
    }
}


def list_commands(group: str) -> dict[str, LazyCommand]:
    """Return the commands of an entry-point group of all installed packages, by name."""
    rows = [row for point in entry_points(group=group) for row in point.load().items()]
    return {name: LazyCommand(f"{place}:command", text) for name, (place, text) in sorted(rows)}


def _complete_names(group: str) -> Any:
    return lambda incomplete: [name for name in list_commands(group) if name.startswith(incomplete)]


def study(
    context: typer.Context,
    name: Annotated[
        str | None,
        typer.Argument(
            help="Name of the study; `--list` lists them.",
            autocompletion=_complete_names("palpate.studies"),
        ),
    ] = None,
    listing: Annotated[bool, typer.Option("--list", help="List the studies.")] = False,
    figure_format: Annotated[
        FigureFormat | None,
        typer.Option("--format", help="With --out: write figures only in this format."),
    ] = None,
    dpi: Annotated[
        int | None,
        typer.Option(
            help="Dots per inch of .png figures; 300 by default.", min=30, max=2400, metavar="N"
        ),
    ] = None,
    quiet: QuietOption = False,
) -> None:
    """Regenerate a table or figure next to the published one.

    `--format pdf|svg|png` and `--dpi N` apply to the figures of `--out`.

    Example: palpate study table1 --out reports
    """
    _check_figure_options(figure_format, dpi, arguments=context.args)
    endings = PLOT_ENDINGS if figure_format is None else (f".{figure_format}",)
    before = FIGURE_FILES.set((endings, dpi))
    try:
        _run_command(name, group="palpate.studies", listing=listing, quiet=quiet, context=context)
    finally:
        FIGURE_FILES.reset(before)


def bench(
    context: typer.Context,
    name: Annotated[
        str | None,
        typer.Argument(
            help="Name of the benchmark; `--list` lists them. Default: all.",
            autocompletion=_complete_names("palpate.benchmarks"),
        ),
    ] = None,
    listing: Annotated[bool, typer.Option("--list", help="List the benchmarks.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Measure speed relative to other software.

    Example: palpate bench --json
    """
    # The options of a benchmark are unknown here, so its first option may be parsed as the name.
    if name is not None and name.startswith("-") and name != "--help":
        context.args.insert(0, name)
        name = None
    _run_command(
        name or ALL, group="palpate.benchmarks", listing=listing, quiet=quiet, context=context
    )


def _run_command(
    name: str | None, *, group: str, listing: bool, quiet: bool, context: typer.Context
) -> None:
    """List the commands of a group, or run one with the remaining arguments."""
    verb, known = str(context.info_name), list_commands(group)
    if listing or name in (None, "--help"):
        text = context.command.help
        listed = LazyGroup(name=verb, help=text, no_args_is_help=True, rich_markup_mode=HELP)
        listed.add_entries(known)
        listed.main(["--help"], prog_name=f"palpate {verb}", standalone_mode=False)
        return
    if name not in known:
        raise InputError(f"no {verb} {name!r}; available: {', '.join(known)}")
    with progress(f"{verb} {name}", quiet=quiet or bool({"--json", "--help"} & set(context.args))):
        command = load_command(name, known[name])
        status = command.main(
            context.args, prog_name=f"palpate {verb} {name}", standalone_mode=False
        )
    if status:
        raise typer.Exit(status)


def _check_figure_options(
    figure_format: FigureFormat | None, dpi: int | None, *, arguments: list[str]
) -> None:
    """Refuse options of figures without effect before the study runs."""
    if figure_format is None and dpi is None:
        return
    option = f"--dpi {dpi}" if figure_format is None else f"--format {figure_format}"
    if not any(one == "--out" or one.startswith("--out=") for one in arguments):
        raise InputError(
            f"{option}: it applies to the figures in --out DIR; add --out or leave it out"
        )
    if dpi is not None and figure_format not in (None, "png"):
        raise InputError(f"--dpi {dpi}: it applies to png only; {figure_format} is a vector format")
