"""Formats of files by their first bytes, and remedies for the others."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, TypeAlias

from palpate.errors import InputError

FileFormat: TypeAlias = Literal["text", "parquet", "spreadsheet"]

#: Bytes that decide the format.
START_BYTES = 512
MCAP_MAGIC = b"\x89MCA"
#: Name of the first entry of other zip archives -> what they are and the remedy.
_ZIPPED = {
    b".npy": ("a NumPy archive", "save the arrays as columns of a CSV file, with numpy.savetxt"),
    b"mimetypeapplication/vnd.oasis": ("an OpenDocument file", "save it as .xlsx or CSV"),
    b"ppt/": ("a presentation", "save its table as CSV"),
    b"word/": ("a Word document", "save its table as CSV"),
}
#: Names of the first entry of workbooks.
_WORKBOOK = (b"[Content_Types].xml", b"xl/", b"_rels/", b"docProps/", b"customXml/")
#: First bytes -> what the file is and the remedy.
_OTHERS = {
    b"\xd0\xcf\x11\xe0": ("an old Excel file", "save it as .xlsx or CSV"),
    b"\x93NUMPY": ("a NumPy array", "save it as a CSV file, with numpy.savetxt"),
    b"#ROSRECORD": ("a ROS 1 bag of an old version", "convert it with `rosbag fix` first"),
    b"MATLAB 7.3 MAT": ("a MATLAB 7.3 file", "save the variables as CSV, with writetable"),
    b"MATLAB 5.0 MAT": ("a MATLAB file", "save the variables as CSV, with writetable"),
    b"\x89HDF\r\n\x1a\n": (
        "an HDF5 file (MATLAB 7.3 files too)",
        "save its columns as CSV; in MATLAB with writetable",
    ),
    b"#ROSBAG": (
        "a ROS 1 bag",
        "save the topic as CSV: `rostopic echo -b FILE -p /TOPIC > topic.csv`",
    ),
    b"SQLite format 3": (
        "an SQLite database (ROS 2 bags and palpate's item store are such)",
        "save the table or the topic as CSV",
    ),
    b"TDSm": (
        "a LabVIEW .tdms file",
        "save it as CSV, with the TDMS add-in of Excel or npTDMS",
    ),
    b"ARROW1": ("a Feather file", "save it as Parquet or CSV"),
    b"RIFF": ("a sound file", "give a table of times and readings"),
    b"%PDF": ("a PDF document", "save its table as CSV"),
    b"<?xml": ("an XML file", "save its table as CSV"),
    b"<!DOCTYPE": ("a web page", "save its table as CSV"),
    b"<html": ("a web page", "save its table as CSV"),
    b"\x80\x02": ("a Python pickle", "save its columns as CSV or Parquet"),
    b"\x80\x03": ("a Python pickle", "save its columns as CSV or Parquet"),
    b"\x89PNG": ("an image", "give the table from which it was drawn"),
    b"\xff\xd8\xff": ("an image", "give the table from which it was drawn"),
    b"\x80\x04": ("a Python pickle", "save its columns as CSV or Parquet"),
    b"\x80\x05": ("a Python pickle", "save its columns as CSV or Parquet"),
    b"BZh": ("a bzip2 archive", "unpack it first"),
    b"\xfd7zXZ": ("an xz archive", "unpack it first"),
    b"7z\xbc\xaf": ("a 7-Zip archive", "unpack it first"),
}


def name_format(start: bytes, *, name: str) -> FileFormat:
    """Return the format of a file with the given first bytes.

    Raises `InputError` if the file is empty, or of a format that can't be read.

    >>> name_format(b"time_s,ohm", name="a.csv")
    'text'
    >>> try:
    ...     name_format(b"#ROSBAG V2.0", name="a.bag")
    ... except InputError as error:
    ...     print(error)
    a.bag: a ROS 1 bag; save the topic as CSV: `rostopic echo -b FILE -p /TOPIC > topic.csv`
    """
    if not start:
        raise InputError(f"{name}: the file is empty; it needs a header and rows")
    if start.startswith(MCAP_MAGIC):
        raise InputError(
            f"{name}: a palpate recording; extract its holds with `palpate export {name} --holds`"
        )
    if start.startswith(b"PAR1"):
        return "parquet"
    known = _OTHERS
    if start.startswith(b"PK\x03\x04"):
        entry = start[26:200]
        found = [text for mark, text in _ZIPPED.items() if mark in entry]
        if not found and start[30:].startswith(_WORKBOOK):
            return "spreadsheet"
        known = {b"PK": (found or [("a zip archive", "unpack it first")])[0]}
    for mark, (what, remedy) in known.items():
        if start.startswith(mark):
            raise InputError(f"{name}: {what}; {remedy}")
    return "text"


def is_mcap(path: Path) -> bool:
    """Return whether a file starts as an MCAP recording; False if it can't be read."""
    try:
        with path.open("rb") as stream:
            return stream.read(len(MCAP_MAGIC)) == MCAP_MAGIC
    except OSError:
        return False
