"""Tables from any logger or of known columns, their contacts, and the holds after contact.

`holds_file` and `strict` want columns of known names and refuse a damaged file with its line.
`table_files` and `recordings` recognise columns, units and clocks of any table and report what is
left out; `contacts` and `cutting` find the holds.
"""

from palpate.holds.hold import SETTLED_WINDOW_S, Hold, find_recorded_value, measure_settled_value
from palpate.holds.holds_file import iterate_holds, read_holds

__all__ = [
    "SETTLED_WINDOW_S",
    "Hold",
    "find_recorded_value",
    "iterate_holds",
    "measure_settled_value",
    "read_holds",
]
