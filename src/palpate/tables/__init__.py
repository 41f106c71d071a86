"""Tables in files: one reader for any table, and a strict way to use it where columns are known.

`read_table_file` takes tables as users have them and reports what it left out. `read_table` and
`read_pieces` want columns of known names, and refuse what can't be used with its line.
"""

from palpate.tables.files import read_table_file
from palpate.tables.strict import Kind, read_pieces, read_table
from palpate.tables.table import Table

__all__ = ["Kind", "Table", "read_pieces", "read_table", "read_table_file"]
