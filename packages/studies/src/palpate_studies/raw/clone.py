"""Read the files of a clone at a commit through git."""

from __future__ import annotations

import gzip
import subprocess
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.files import atomic_path


class Clone:
    """The files of one commit of a clone.

    Attributes
    ----------
    path : Path
        Folder of the clone.
    commit : str
        Commit to read: the pinned commit if the clone contains it, else the head.
    pinned : bool
        Whether the pinned commit is read.
    names : tuple of str
        All files of the commit.
    """

    def __init__(self, path: Path, *, commit: str) -> None:
        self.path = path
        if self._git("rev-parse", "--verify", "HEAD") is None:
            raise InputError(f"{path}: not a git clone with a commit; clone the repository there")
        found = commit and self._git("rev-parse", "--verify", "--quiet", f"{commit}^{{commit}}")
        self.pinned = bool(found) or not commit
        self.commit = commit if found else "HEAD"
        listed = self._git("ls-tree", "-r", "-z", "--name-only", self.commit) or b""
        self.names = tuple(name for name in listed.decode().split("\0") if name)

    def under(self, folder: str, *, ending: str = "") -> list[str]:
        """Return the files below a folder, sorted."""
        return sorted(n for n in self.names if n.startswith(folder) and n.endswith(ending))

    def read(self, name: str) -> bytes:
        """Return a file's content; raises `InputError` if git can't read it."""
        content = self._git("show", f"{self.commit}:{name}")
        if content is None:
            raise InputError(f"{self.path}: git can't read {name} at {self.commit}; fetch it")
        return content

    def _git(self, *arguments: str) -> bytes | None:
        command = ["git", "-C", str(self.path), *arguments]
        try:
            done = subprocess.run(command, capture_output=True, check=False)
        except OSError as error:
            raise InputError(f"git: {error.strerror}; install git") from error
        return done.stdout if done.returncode == 0 else None


def parse_numbers(text: bytes, *, columns: int, separator: str | None = None) -> FloatArray:
    """Return the numeric lines of a text, shape (n, columns); skip headers and broken lines.

    >>> parse_numbers(b"time value\\n1 2.5 x\\n3\\n4 5\\n", columns=2).tolist()
    [[1.0, 2.5], [4.0, 5.0]]
    """
    rows = []
    for line in text.decode("utf-8", "replace").splitlines():
        try:
            row = [float(field) for field in line.split(separator)[:columns]]
        except ValueError:
            continue
        if len(row) == columns and np.isfinite(row).all():
            rows.append(row)
    return np.array(rows, dtype=float).reshape(-1, columns)


def write_table(
    path: Path, columns: Sequence[str], rows: Iterable[Sequence[str | float | int]]
) -> int:
    """Write a table, compressed if the name ends in .gz; return the number of rows."""
    lines = [",".join(columns)]
    lines += [",".join(_format_field(value) for value in row) for row in rows]
    text = ("\n".join(lines) + "\n").encode()
    with atomic_path(path) as partial:
        # Without a time stamp, so that the output of a clone is reproducible.
        partial.write_bytes(gzip.compress(text, mtime=0) if path.suffix == ".gz" else text)
    return len(lines) - 1


def _format_field(value: str | float | int) -> str:
    return f"{value:.10g}" if isinstance(value, float) else str(value)
