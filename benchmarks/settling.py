"""The benchmark of the settled-value predictors; the same as `palpate bench settling`."""

from __future__ import annotations

import sys

from palpate.cli import run
from palpate.commands.bench import bench

if __name__ == "__main__":
    import typer

    app = typer.Typer(pretty_exceptions_enable=False, add_completion=False)
    app.command()(bench)
    sys.exit(run(app, ["settling", *sys.argv[1:]], name="settling.py"))
