"""Recordings as MCAP files: contents, writing, reading, replay, export and recovery.

This layer is above `palpate.sensor` and `palpate.gripper`, because a recording contains the frames
of one and the states of the other.
"""

from palpate.recording.contents import Event, LoadCells, Origin, Recording, RecordingInfo
from palpate.recording.reader import FileState, RecordingReader, load_recording
from palpate.recording.recover import recover
from palpate.recording.replay import Replay, ReplayGripper
from palpate.recording.writer import RecordingWriter

__all__ = [
    "Event",
    "FileState",
    "LoadCells",
    "Origin",
    "Recording",
    "RecordingInfo",
    "RecordingReader",
    "RecordingWriter",
    "Replay",
    "ReplayGripper",
    "load_recording",
    "recover",
]
