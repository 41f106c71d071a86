"""epcis2.js, a library of EPCIS 2.0 by others, as a judge of documents."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from tests.fixtures import skip

#: Brought by `make .venv/.dev` from the npm registry.
LIBRARY = Path(sys.prefix) / "epcis2.js"
_PROGRAM = """
const { EPCISDocument, validateEpcisDocument } = require(process.argv[1]);
const document = JSON.parse(require("fs").readFileSync(0));
try {
  validateEpcisDocument(document);
  const events = new EPCISDocument(document).toObject().epcisBody.eventList;
  process.stdout.write(JSON.stringify(events));
} catch (error) {
  // The message alone: with it Node.js would print the library's one long line of code.
  process.stderr.write(String(error.message));
  process.exitCode = 1;
}
"""


def read_epcis(document: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the events that epcis2.js reads from a document that its schemas accept."""
    if not LIBRARY.exists() or shutil.which("node") is None:
        skip(f"no node or no {LIBRARY}: install Node.js, then `make .venv/.dev`")
    done = subprocess.run(
        ["node", "-e", _PROGRAM, str(LIBRARY)],
        input=json.dumps(document, allow_nan=False),
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    events: list[dict[str, Any]] = json.loads(done.stdout)
    return events
