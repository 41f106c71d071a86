"""List the stored results whose study's code has changed since the run.

Usage: python docs/old_results.py

A changed file does not always change a figure. To update a result, run the printed command with
docs/keep_result.py.
"""

from __future__ import annotations

import sys
from pathlib import Path

from palpate_studies.scoreboard import read_stored_results
from palpate_studies.study_code import code_hash


def main() -> None:
    """Print name, date and command of each outdated result."""
    sys.stdout.writelines(
        f"{name}, made on {one['made_on']}: {one['command']}\n"
        for name, one in read_stored_results(Path(__file__).parent).items()
        if one["code_sha256"] != code_hash(one["study"])
    )


if __name__ == "__main__":
    main()
