"""Output for terminals whose encoding lacks our signs: plainer ones, never a traceback."""

from __future__ import annotations

import codecs
import sys
from io import TextIOWrapper

#: One sign for one sign, so that tables stay straight. What is not here becomes a question mark.
_PLAIN = str.maketrans("…·●▼✗✓×−–─│├┤┼▁▂▃▄▅▆▇█", "~|ovx+x--" + "-||" + "|+" + ".:-=+*##")


def print_anything() -> None:
    """Let standard output and standard error print every text."""
    codecs.register_error("palpate.plain", _plainer)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="palpate.plain")


def _plainer(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end].translate(_PLAIN)
    return text.encode("ascii", errors="replace").decode("ascii"), error.end
