"""How each kind of failure is reported to a user: one line and an exit status."""

from __future__ import annotations

import errno
import sys
from collections.abc import Sequence
from typing import Any

import typer

from palpate.errors import PalpateError

EXIT_STOPPED = 130
_UNANSWERED = "run it in a terminal, or use an option (--help)"
#: What to do about the failures of a disk; for others the system's own message is enough.
_REMEDIES = {
    errno.EACCES: "change the permissions of the file or its folder, or choose another place",
    errno.EROFS: "choose a place that can be written to",
    errno.ENOSPC: "make room, or choose another disk",
}
#: Failures of a disk that no other argument remedies.
_EQUIPMENT = (errno.ENOSPC, errno.EDQUOT, errno.EIO)


def run(app: Any, arguments: Sequence[str], *, name: str) -> int:
    """Run a Typer app or its command; turn every foreseen failure into one line and an exit status.

    Returns 0 done, 1 the answer is no, 2 bad usage or input, 3 equipment, 130 stopped by Ctrl-C.
    """
    command = typer.main.get_command(app) if isinstance(app, typer.Typer) else app
    try:
        status = command.main(args=list(arguments), prog_name=name, standalone_mode=False)
        return int(status or 0)
    except PalpateError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return error.exit_status
    except typer.TyperException as error:
        context = getattr(error, "ctx", None)
        verb = context.command_path if context is not None else name
        message = " ".join(error.format_message().split()).replace("Value error, ", "")
        if message:  # empty where the help was printed instead
            end = "" if message.endswith((".", "?", "!")) else "."
            print(f"{name}: {message}{end} Try `{verb} --help`.", file=sys.stderr)
        return 2
    except (KeyboardInterrupt, typer.Abort) as error:
        if isinstance(error.__context__, EOFError):
            print(f"\n{name}: nobody answers; {_UNANSWERED}", file=sys.stderr)
            return 2
        print(f"{name}: stopped", file=sys.stderr)
        return EXIT_STOPPED
    except BrokenPipeError:
        # The reader of our output left (`| head`): nothing more to print, and nothing went wrong.
        sys.stderr.close()
        return 0
    except OSError as error:
        what = [error.filename, error.strerror or error]
        remedy = _REMEDIES.get(error.errno or 0)
        reason = ": ".join(str(part) for part in what if part)
        print(f"{name}: {reason}" + (f"; {remedy}" if remedy else ""), file=sys.stderr)
        return 3 if error.errno in _EQUIPMENT else 2
