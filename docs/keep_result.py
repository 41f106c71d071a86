"""Run a study and store the figures that pages quote, with command and code hash.

Usage: python docs/keep_result.py NAME real|simulated KEY[,KEY...] [NOTE] -- study [OPTIONS]

NOTE states seeds, number of evaluations on the test set, and any shortcuts. KEYs are keys of the
study's JSON document; omit rows of single cases. Example:

    python docs/keep_result.py rupture real tradeoff,compared -- rupture --curves C --index I
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from palpate_studies.scoreboard import store_result
from palpate_studies.study_code import code_hash

#: The command of this interpreter's palpate, which need not be on the path.
RUN = "import sys; from palpate.cli import main; sys.exit(main())"


def main() -> None:
    """Run the study and store the selected figures."""
    end = sys.argv.index("--")
    name, origin, keys, *note = sys.argv[1:end]
    arguments = ["study", *sys.argv[end + 1 :]]
    # Computed before the run, because the code may change meanwhile.
    code_sha256 = code_hash(arguments[1])
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
        code_sha256=code_sha256,
    )


if __name__ == "__main__":
    main()
