"""Run a study and keep the figures that claims quote, with what made them.

Usage: python docs/keep_result.py NAME real|simulated KEY[,KEY...] [NOTE] -- study [OPTIONS]

NOTE: seeds, looks, and what was cut short. KEYs are names in the study's JSON document; rows of
single cases stay out. Example:

    python docs/keep_result.py rupture real tradeoff,compared -- rupture --curves C --index I
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from palpate_studies.scoreboard import store_result
from palpate_studies.study_code import code_hash

#: `palpate` of this interpreter, installed or not on the path.
RUN = "import sys; from palpate.cli import main; sys.exit(main())"


def main() -> None:
    """Run, pick, write."""
    end = sys.argv.index("--")
    name, origin, keys, *note = sys.argv[1:end]
    arguments = ["study", *sys.argv[end + 1 :]]
    # Before the study runs: the code may change while it does.
    ran = code_hash(arguments[1])
    done = subprocess.run(
        [sys.executable, "-c", RUN, *arguments, "--json"],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    )
    document = json.loads(done.stdout)
    shown = " ".join(["palpate", *(Path(a).name if "/" in a else a for a in arguments)])
    store_result(
        name,
        docs=Path(__file__).parent,
        command=shown,
        origin=origin,
        figures={key: document[key] for key in keys.split(",")},
        note=" ".join(note),
        code_sha256=ran,
    )


if __name__ == "__main__":
    main()
