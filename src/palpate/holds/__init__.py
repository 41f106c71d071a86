"""Read tables of sensor readings, find contacts and cut the hold after each contact.

`holds_file` and `strict` require columns of known names; the error for a damaged file names the
line. `table_files` and `recordings` recognise columns, units and clocks in any table and report
every omission. `contacts` and `cutting` find the holds.
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
