"""Making a cut or damaged recording whole for strict readers, keeping every intact message."""

from __future__ import annotations

import os

from palpate.errors import RecordingError, RecordingLostError
from palpate.files import atomic_path
from palpate.recording.blocks import FileState
from palpate.recording.reader import RecordingReader
from palpate.recording.writer import RecordingWriter


def recover(source: str | os.PathLike[str], destination: str | os.PathLike[str]) -> FileState:
    """Record all that can be read of `source` again, into a finished file.

    Parameters
    ----------
    source : path
        A recording that was not finished, or is damaged.
    destination : path
        Written whole or not at all; may be `source` itself.

    Returns
    -------
    FileState
        What was found in `source`.

    Raises
    ------
    RecordingError
        If `source` is not a recording of palpate, or `destination` can't be written.
    """
    state = FileState()
    try:
        with RecordingReader(source) as reader, atomic_path(destination) as partial:
            partial.unlink()  # the writer makes files, and never takes one that is there
            with RecordingWriter(partial, info=reader.info) as writer:
                for message in reader.messages(state=state):
                    writer.add(message)
    except RecordingLostError as error:
        raise RecordingError(f"{destination}: {error.__cause__}") from error
    except OSError as error:
        raise RecordingError(f"{destination}: {error.strerror}") from error
    return state
