"""The `palpate` command: a table of verbs whose modules are loaded on first use."""

from __future__ import annotations

import errno
import signal
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from io import TextIOWrapper
from typing import Annotated, Any

import typer

import palpate
from palpate.cli.lazy_group import HELP, LazyCommand, LazyGroup
from palpate.cli.options import opt
from palpate.cli.output import (
    is_output_lost,
    is_terminal_lost,
    print_message,
    silence_lost_output,
)
from palpate.errors import DISK_FAILURES, DamageWarning, PalpateError
from palpate.stop_signals import HANGUP, install, interrupt

#: Verb of another package -> the package and its folder in the source, for the message if the
#: package is not installed.
_PACKAGES = {
    verb: (f"palpate-{package}", f"packages/{package}")
    for package, verbs in {
        "station": ("serve", "items", "report", "ripeness", "bruise", "sort", "qualify", "teach"),
        "pattern": ("pattern",),
        "archive": ("archive",),
        "studies": ("study", "bench"),
    }.items()
    for verb in verbs
}
#: Help heading -> verb -> summary. The summary repeats the first paragraph of the docstring of
#: `palpate.cli.VERB.VERB`.
GROUPS = {
    "Measure": {
        "grasp": "Close on an unknown object, measure size, force and stiffness, and release it.",
        "live": "Show pixels, contact, rate and losses in the terminal.",
        "serve": "Serve the dashboard: pixels, prediction and verdict; grasp, calibrate, replay.",
        "record": "Record a board, or a rig with its gripper.",
    },
    "Recordings": {
        "settle": "Predict the settled values of recordings from their first seconds.",
        "force": "Convert readings to newtons, from weights or a load cell.",
        "inspect": "Show the contents of a recording and whether the file is complete.",
        "replay": "Run a recorded grasp through the controller again.",
        "export": "Write a recording as a table of frames or holds, or grasps for LeRobot.",
        "archive": "Store grasps, holds and frames as partitioned Parquet, and re-evaluate them.",
    },
    "Set up": {
        "demo": "Show a simulated grasp, or write simulated example files.",
        "init": "Write a rig file.",
        "ports": "List serial ports, likely boards first.",
        "flash": "Write the firmware with avrdude, verify it, and query the board's version.",
        "doctor": "Find faulty or swapped pixels, lost frames and a wrong reference resistor.",
        "calibrate": "Create or update a part of the calibration file.",
        "pattern": "Draw the cut files of a sensor: base, copper, Velostat, copper and cover.",
    },
    "Produce": {
        "items": "List items, show one, label one, or write them to Parquet.",
        "report": "Write a web page about an item, a batch or a day.",
        "ripeness": "Report how ripe items are and when they will be ripe.",
        "bruise": "Judge whether an item is bruised, from the grasps of its last visit.",
        "sort": "Sort items into bins by readable rules, or identify one item.",
        "qualify": "Qualify grasps against a penetrometer, a durometer or a buyer's grades.",
        "teach": "Learn a label from grasps, report the accuracy, and name unlabelled items.",
    },
    "Research": {
        "study": "Regenerate a table or figure next to the published one.",
        "bench": "Measure speed relative to other software.",
    },
}
#: Verb -> module, for verbs whose module has a different name.
_MODULES = {"ports": "flash"}
VERBS = {
    verb: LazyCommand(
        f"palpate.cli.{_MODULES.get(verb, verb)}:{verb}", summary, heading, _PACKAGES.get(verb)
    )
    for heading, verbs in GROUPS.items()
    for verb, summary in verbs.items()
}


def build_app() -> LazyGroup:
    """Build the command with its verbs."""
    app = typer.Typer(cls=LazyGroup, name="palpate", no_args_is_help=True, rich_markup_mode=HELP)

    @app.callback()
    def root(
        version: Annotated[bool, opt("--version", "Print the version.", callback=_version)] = False,
    ) -> None:
        """Examine produce by touch with a cheap resistive pressure sensor on any gripper."""

    group = typer.main.get_command(app)
    assert isinstance(group, LazyGroup)
    group.add_entries(VERBS)
    return group


def _version(wanted: bool) -> None:
    if wanted:
        print(f"palpate {palpate.__version__}")
        raise typer.Exit


def main() -> None:
    """Entry point of the `palpate` script."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            # A terminal with a limited encoding shows a question mark for each unknown character.
            stream.reconfigure(errors="replace")
    # As the first process of a container, only a signal with a handler ends it. Servers that handle
    # SIGTERM themselves handle SIGHUP too, because it is passed on.
    # A shell lets background commands ignore Ctrl-C, which stays so.
    ignores_ctrl_c = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    install(interrupt, numbers=(signal.SIGTERM, *[signal.SIGINT] * (not ignores_ctrl_c)))
    install(lambda *_: signal.raise_signal(signal.SIGTERM), numbers=HANGUP)
    status = EXIT_STOPPED
    with suppress(KeyboardInterrupt):
        status = run(build_app(), sys.argv[1:], name="palpate")
        # All files are complete. At its end Python would restore the default actions, which change
        # the status.
        install(signal.SIG_IGN)
    sys.exit(status)


EXIT_STOPPED = 130
_UNANSWERED = (
    "run the command in a terminal, or pipe a line to it for each request, an empty one for Enter"
)
#: Remedies of file-system errors; for other errors the system's message is enough.
_REMEDIES = {
    errno.EACCES: "change the permissions of the file or its folder, or choose another location",
    errno.EROFS: "choose a writable location",
    errno.ENOSPC: "free some space, or choose another disk",
}


def run(app: Any, arguments: Sequence[str], *, name: str) -> int:
    """Run a Typer app; report each expected failure as one line and an exit status.

    Returns 0 for success, 1 for a negative answer, 2 for bad usage or input, 3 for failed
    equipment and 130 after Ctrl-C, SIGTERM or SIGHUP.
    """
    command = typer.main.get_command(app) if isinstance(app, typer.Typer) else app

    def show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
        print_message(f"{name}: warning: {message}")

    with warnings.catch_warnings():
        # Each text once, even if a command reads a file several times.
        warnings.simplefilter("default", DamageWarning)
        warnings.showwarning = show_warning
        return _run(command, arguments, name=name)


def _run(command: Any, arguments: Sequence[str], *, name: str) -> int:
    try:
        status = command.main(args=list(arguments), prog_name=name, standalone_mode=False)
        sys.stdout.flush()
        return int(status or 0)
    except PalpateError as error:
        print_message(f"{name}: {error}")
        return error.exit_status
    except typer.TyperException as error:
        context = getattr(error, "ctx", None)
        verb = context.command_path if context is not None else name
        message = " ".join(error.format_message().split()).replace("Value error, ", "")
        if message:  # empty if the help was printed instead
            end = "" if message.endswith((".", "?", "!")) else "."
            print_message(f"{name}: {message}{end} Try `{verb} --help`.")
        return 2
    except (KeyboardInterrupt, typer.Abort) as error:
        if isinstance(error.__context__, EOFError):
            print_message(f"\n{name}: no answer on standard input; {_UNANSWERED}")
            return 2
        print_message(f"{name}: stopped")
        return EXIT_STOPPED
    except OSError as error:
        if is_output_lost(error):
            silence_lost_output()
            # A reader that closes the pipe (`| head`) is not an error.
            return EXIT_STOPPED if is_terminal_lost(error) else 0
        what = [error.filename, error.strerror or error]
        remedy = _REMEDIES.get(error.errno or 0)
        reason = ": ".join(str(part) for part in what if part)
        print_message(f"{name}: {reason}" + (f"; {remedy}" if remedy else ""))
        return 3 if error.errno in DISK_FAILURES else 2
    finally:
        silence_lost_output()
