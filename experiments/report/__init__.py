"""What results look like to people: a table for the terminal, ``report.html`` and ``report.md``.

:mod:`.tables` makes the tables, :mod:`.sentences` what is said of them; writers only lay them out.
"""

from .text import text_table

__all__ = ["text_table"]
