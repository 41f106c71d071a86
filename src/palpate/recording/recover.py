"""Recovery of a truncated or damaged recording for strict readers."""

from __future__ import annotations

import os

from palpate.errors import RecordingError, RecordingLostError
from palpate.files import atomic_path
from palpate.recording.blocks import FileState
from palpate.recording.reader import RecordingReader
from palpate.recording.writer import RecordingWriter


def recover(source: str | os.PathLike[str], destination: str | os.PathLike[str]) -> FileState:
    """Write all readable messages of `source` to a complete recording.

    Parameters
    ----------
    source : path
        A truncated or damaged recording.
    destination : path
        Written atomically; may be `source` itself.

    Returns
    -------
    FileState
        Completeness and damage of `source`.

    Raises
    ------
    RecordingError
        If `source` is not a palpate recording, or `destination` can't be written.
    """
    try:
        with RecordingReader(source) as reader, atomic_path(destination) as partial:
            partial.unlink()  # the writer refuses an existing file
            with RecordingWriter(partial, info=reader.info) as writer:
                for message in reader.readable_messages():
                    writer.add(message)
    except RecordingLostError as error:
        raise RecordingError(f"{destination}: {error.__cause__}") from error
    except OSError as error:
        raise RecordingError(f"{destination}: {error.strerror}") from error
    return reader.state
