"""`palpate export FILE --rerun OUT.rrd`: a recording as a file for the Rerun viewer."""

from __future__ import annotations

from pathlib import Path

from palpate.errors import InputError
from palpate.files import atomic_path, check_new
from palpate.recording import Recording, RecordingReader
from palpate.viewer import show_recording
from palpate_rerun.viewer import open_file


def export_rerun(file: Path, *, out: Path) -> Recording:
    """Write a recording with its changes, forces and phases as an `.rrd` file.

    Parameters
    ----------
    file : Path
        A recording of palpate.
    out : Path
        File to write, whose name ends in `.rrd`; written atomically.

    Returns
    -------
    Recording
        The recording.

    Raises
    ------
    InputError
        If the output file exists, or its name ends otherwise.
    RecordingError, CalibrationError
        As `palpate.viewer.show_recording`.
    """
    if out.suffix.lower() != ".rrd":
        raise InputError(f"--rerun {out}: the name must end in .rrd")
    with RecordingReader(file) as reader:  # a file that is not a recording is refused first
        info = reader.info
    check_new(out, option="--rerun FILE")
    zero_unix_ns = info.clock_zero_unix_ns
    simulated = "" if info.origin == "hardware" else " (SIMULATED)"
    source = f"{info.rig or info.layout.name}{simulated}"
    with atomic_path(out) as partial:
        viewer = open_file(
            partial,
            title=file.stem,
            source=f"{source}, {file.name}",
            layout=info.layout,
            unix_ns=(lambda time_s: zero_unix_ns + round(time_s * 1e9)) if zero_unix_ns else None,
        )
        try:
            recording = show_recording(file, viewer)
        finally:
            viewer.close()
    return recording
