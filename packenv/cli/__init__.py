"""The command line ``robotpack``: one module a command, its words (``parser``), exit codes and output.

May import the API and all below it; the modules of commands are imported only when they are run. Exit codes: 0
done, 1 something could not be packed or a check failed, 2 bad input.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: arguments without the program's name; None takes those of the process.

    Returns:
        The exit code.
    """
    from packenv.cli.exit_codes import reported
    from packenv.cli.parser import command_line

    arguments = command_line().parse_args(argv)

    def work() -> int:
        name = arguments.module
        module = importlib.import_module(name if "." in name else f"packenv.cli.{name}")
        code: int = module.run(arguments)
        return code

    return reported("robotpack", work)
