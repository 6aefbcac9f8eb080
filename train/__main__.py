"""``python -m packenv.train``: train a placement policy.

Exit codes: 0 done, 1 an environment's process died, 2 bad input, 130 stopped. After 1 and 130 ``--resume``
goes on from the last checkpoint.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from packenv.agents.__main__ import read_document
from packenv.cli.exit_codes import reported
from packenv.errors import InputError


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command.

    Args:
        argv: arguments without the program's name; None takes those of the process.

    Returns:
        The exit code.
    """
    arguments = _parser().parse_args(argv)
    again = f"--resume --out {arguments.out} goes on from the last checkpoint"

    def work() -> int:
        try:
            _run(arguments)
        except (EOFError, ConnectionError):
            # What SubprocVecEnv raises when the other end of a pipe has gone.
            sys.stderr.write(f"train: an environment's process died, for want of memory perhaps; {again}\n")
            return 1
        return 0

    return reported("train", work, stopped=f"stopped; {again}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=f"python -m {__package__}",
        description="Train a placement policy with MaskablePPO. Options that are given override --config.",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the run")
    parser.add_argument("--timesteps", type=int, metavar="N", help="steps to train for, over all workers")
    parser.add_argument("--resume", action="store_true", help="go on from the last checkpoint in DIR")
    parser.add_argument("--seed", type=int, help="of weights, samples and orders")
    parser.add_argument("--workers", type=int, help="environments, each in its own process (1: in this one)")
    parser.add_argument("--threads", type=int, help="of torch")
    for option, what in (
        ("--env-config", "the environment's configuration"),
        ("--order-generator", "the orders to train on"),
        ("--evaluation-order-generator", "the orders of the held-out episodes"),
        ("--reward", "weights of the reward's terms"),
        ("--config", "the whole training configuration, as in a run's config.json under 'train'"),
    ):
        parser.add_argument(option, metavar="JSON|FILE", help=what)
    return parser


def _run(arguments: argparse.Namespace) -> None:
    try:
        from .learning import run
    except ModuleNotFoundError as problem:
        if problem.name is None or problem.name.split(".")[0] in ("packenv", "train"):
            raise
        raise InputError(
            f"training needs the package {problem.name}: pip install 'robotpack[train]'"
        ) from None
    from .config import TrainConfig
    from .runs import RunFolder

    folder = RunFolder(arguments.out)
    given = {
        name: value
        for name in ("timesteps", "seed", "workers", "threads")
        if (value := getattr(arguments, name)) is not None
    }
    for name in ("env_config", "order_generator", "evaluation_order_generator", "reward"):
        if (text := getattr(arguments, name)) is not None:
            given[name] = read_document(text, f"--{name.replace('_', '-')}")
    base = {} if arguments.config is None else read_document(arguments.config, "--config")
    if folder.begun:
        if not arguments.resume:
            raise InputError(f"--out {folder.path}: holds a run, go on with --resume or give another folder")
        begun = folder.config()
        config = TrainConfig.from_mapping({**begun.to_mapping(), **base, **given})
        changed = replace(begun, timesteps=config.timesteps, workers=config.workers, threads=config.threads)
        if changed != config:
            raise InputError(
                f"--resume: {folder.path} was begun with another configuration; "
                "only --timesteps, --workers and --threads can be changed"
            )
    else:
        config = TrainConfig.from_mapping({**base, **given})
    run(folder, config, _report)


def _report(row: dict[str, Any]) -> None:
    who = f"step {row['timesteps']:,}" if "timesteps" in row else row["agent"]
    sys.stdout.write(
        f"{who:>14}  return {row['return']:.3f} ± {row['return_ci95']:.3f}  "
        f"packed {row['packed_share']:.1%}  complete {row['complete']:.1%}  "
        f"utilization {row['utilization']:.1%}\n"
    )
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
