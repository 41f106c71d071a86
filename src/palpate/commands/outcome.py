"""What each kind of failure means to a user: one line and an exit status."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import typer

from palpate.errors import PalpateError

EXIT_STOPPED = 130


def run(app: typer.Typer, arguments: Sequence[str], *, name: str) -> int:
    """Run a Typer app; turn every foreseen failure into one line and an exit status.

    Returns
    -------
    int
        0 done, 1 the answer is no, 2 bad usage or input, 3 equipment, 130 stopped by Ctrl-C.
    """
    command = typer.main.get_command(app)
    try:
        status = command.main(args=list(arguments), prog_name=name, standalone_mode=False)
        return int(status or 0)
    except PalpateError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return error.exit_status
    except typer.TyperException as error:
        context = getattr(error, "ctx", None)
        verb = context.command_path if context is not None else name
        message = " ".join(error.format_message().split())
        print(f"{name}: {message} Try `{verb} --help`.", file=sys.stderr)
        return 2
    except (KeyboardInterrupt, typer.Abort):
        print(f"{name}: stopped", file=sys.stderr)
        return EXIT_STOPPED
    except BrokenPipeError:
        # The reader of our output left (`| head`): nothing more to say, and nothing went wrong.
        sys.stderr.close()
        return 0
    except OSError as error:
        where = f" {error.filename}" if error.filename else ""
        print(f"{name}:{where}: {error.strerror or error}", file=sys.stderr)
        return 2
