"""Making a cut or damaged recording whole for strict readers, keeping every intact message."""

from __future__ import annotations

import os
from pathlib import Path
from typing import BinaryIO

from mcap.records import Channel, Metadata, Schema
from mcap.writer import Writer

from palpate.errors import RecordingError
from palpate.files import atomic_path
from palpate.recording.blocks import FileState, read_blocks
from palpate.recording.channels import METADATA_NAME, decode_info
from palpate.recording.writer import LIBRARY


def recover(source: str | os.PathLike[str], destination: str | os.PathLike[str]) -> FileState:
    """Copy all that can be read of `source` into a finished file.

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
        If `source` is not a recording of palpate.
    """
    state = FileState()
    try:
        with (
            Path(source).open("rb") as stream,
            atomic_path(destination) as partial,
            partial.open("wb") as finished,
        ):
            writer = Writer(finished, chunk_size=1 << 22, enable_data_crcs=True)
            writer.start(profile="", library=LIBRARY)
            _copy(stream, writer, state)
            writer.finish()
    except OSError as error:
        where = error.filename or source
        raise RecordingError(f"{where}: {error.strerror}") from error
    except RecordingError as error:
        raise RecordingError(f"{source}: {error}") from error
    return state


def _copy(stream: BinaryIO, writer: Writer, state: FileState) -> None:
    known = False
    schema_ids: dict[int, int] = {0: 0}
    channel_ids: dict[int, int] = {}
    for block in read_blocks(stream, state=state):
        for record in block:
            if isinstance(record, Metadata):
                if record.name == METADATA_NAME:
                    decode_info(record.metadata)
                    known = True
                writer.add_metadata(record.name, record.metadata)
            elif isinstance(record, Schema):
                if record.id not in schema_ids:
                    new = writer.register_schema(record.name, record.encoding, record.data)
                    schema_ids[record.id] = new
            elif isinstance(record, Channel):
                if record.id not in channel_ids and record.schema_id in schema_ids:
                    channel_ids[record.id] = writer.register_channel(
                        record.topic,
                        record.message_encoding,
                        schema_ids[record.schema_id],
                        record.metadata,
                    )
            elif record.channel_id in channel_ids:
                writer.add_message(
                    channel_ids[record.channel_id],
                    log_time=record.log_time,
                    data=record.data,
                    publish_time=record.publish_time,
                    sequence=record.sequence,
                )
        writer.flush()
    if not known:
        raise RecordingError("an MCAP file, but not a recording of palpate (no such metadata)")
