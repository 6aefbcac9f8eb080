"""``python -m packenv`` is ``robotpack``."""

from __future__ import annotations

import sys

from packenv.cli import main

if __name__ == "__main__":
    sys.exit(main())
