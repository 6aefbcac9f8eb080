"""What results look like to people: a table for the terminal, ``report.html`` and ``report.md``.

:mod:`.tables` makes the tables, :mod:`.sentences` what is said of them; writers only lay them out.
"""

from .gallery import Pictures
from .text import text_table
from .writing import write_report

__all__ = ["Pictures", "text_table", "write_report"]
