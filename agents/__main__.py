"""Compare agents in the environment: ``python -m packenv.agents --agent hm,dblf,planner --episodes 20``.

Every agent gets the same orders. With ``--out``, each finished episode is a line of that file at once, and a
run that was stopped goes on where it was. Exit codes: 0 done, 1 an episode failed, 2 bad input.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from packenv.cli import numbers
from packenv.cli.exit_codes import reported
from packenv.env.presets import PRESETS
from packenv.errors import InputError
from packenv.extensions import is_extension
from packenv.json_text import parse_json, read_json

from .registry import NAMES, check_name

if TYPE_CHECKING:
    from .running import EpisodeJob, EpisodeRecord, FailedEpisode, Setting


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: arguments without the program's name; None takes those of the process.

    Returns:
        The exit code.
    """
    arguments = _parser().parse_args(argv)
    # One thread a process, before any library reads this: more of them only get into each other's way, and
    # sums in another sequence could tip a learned policy's choice.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    return reported("agents", lambda: _run(arguments))


def read_document(text: str, option: str) -> dict[str, object]:
    """A mapping that the user gave as JSON, or as a file of JSON.

    Args:
        text: what followed the option; JSON where it begins with ``{``.
        option: its name, for messages.

    Raises:
        InputError: no such file, no JSON, or no mapping.
    """
    inline = text.lstrip().startswith("{")
    where = option if inline else f"{option} {text}"
    right = "a file of JSON or JSON itself"
    try:
        document = parse_json(text, option, right) if inline else read_json(Path(text), right)
    except InputError as problem:
        raise problem if inline else InputError(f"{option} {problem}") from None
    if not isinstance(document, dict):
        raise InputError(f"{where}: is {document!r:.60}, give a mapping, in braces")
    return document


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=f"python -m {__package__}",
        description="Run agents through episodes of RobotPack-v0 and compare them on the same orders.",
        epilog="Exit codes: 0 done, 1 an episode failed, 2 bad input.",
    )
    parser.add_argument(
        "--agent",
        required=True,
        metavar="NAME[,NAME...]",
        help=f"one or several of {', '.join(NAMES)}; your own as my_module:MyAgent",
    )
    parser.add_argument(
        "--episodes",
        type=numbers.at_least_one,
        default=20,
        metavar="N",
        help="of each agent (default: %(default)s)",
    )
    parser.add_argument(
        "--seed", type=numbers.seed, default=0, metavar="N", help="of the run (default: %(default)s)"
    )
    parser.add_argument(
        "--env-config", metavar="FILE|JSON", help='the environment\'s settings, such as {"mask": "legal"}'
    )
    parser.add_argument(
        "--order-generator",
        metavar="FILE|JSON|MODULE:NAME",
        help='the orders, such as {"kind": "random", "items": [5, 10]}, or a generator of your own '
        "(default: ten random items)",
    )
    parser.add_argument(
        "--preset", choices=tuple(PRESETS), help="environment and orders by a word (docs/environment.md)"
    )
    parser.add_argument("--weights", type=Path, metavar="DIR", help="what train wrote, for the agent learned")
    parser.add_argument(
        "--trust", action="store_true", help="let --weights be a zip, which can run any code while it is read"
    )
    parser.add_argument(
        "--workers",
        type=numbers.at_least_one,
        default=1,
        metavar="N",
        help="processes (default: %(default)s)",
    )
    parser.add_argument(
        "--out", type=Path, metavar="ROWS", help="keep every episode here (JSON lines), and go on from it"
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    return parser


def _run(arguments: argparse.Namespace) -> int:
    preset = None if arguments.preset is None else PRESETS[arguments.preset]
    if preset is not None and (arguments.env_config or arguments.order_generator):
        raise InputError("--preset: is environment and orders, leave --env-config and --order-generator out")
    config = _document(arguments.env_config, "--env-config") if preset is None else dict(preset.config)
    options = _agent_options(arguments, config)
    given = arguments.order_generator
    own = given is not None and is_extension(given) and "{" not in given and not Path(given).exists()
    orders = given if own else _document(given, "--order-generator")
    orders = orders if preset is None else dict(preset.order_generator)

    # Only now: --help and mistakes need not wait for the planner's libraries.
    from packenv.env.config import PackConfig

    from .running import AgentSpec, EpisodeRecord, FailedEpisode, Setting, episode_jobs
    from .summary import summarize, table

    setting = Setting(PackConfig.from_mapping(config or {}), orders)
    agents = [AgentSpec(name, given) for name, given in options.items()]
    jobs = episode_jobs(agents, setting, episodes=arguments.episodes, seed=arguments.seed)
    results = _results(jobs, setting, arguments)
    failed = [result for result in results if isinstance(result, FailedEpisode)]
    done = sorted((r for r in results if isinstance(r, EpisodeRecord)), key=lambda r: r.episode)
    by_agent = {name: [record for record in done if record.agent == name] for name in options}
    summaries = [summarize(name, records) for name, records in by_agent.items() if records]
    if arguments.json:
        document = {
            "env_config": setting.config.to_mapping(),
            "order_generator": orders,
            "seed": arguments.seed,
            "agents": [asdict(summary) for summary in summaries],
            "failed": [asdict(failure) for failure in failed],
        }
        print(json.dumps(document, indent=1, allow_nan=False))  # noqa: T201
    elif summaries:
        print(table(summaries))  # noqa: T201
    for failure in failed:
        where = f"episode {failure.episode} of {failure.agent} (seed {failure.seed})"
        print(f"agents: {where} failed: {failure.error}", file=sys.stderr)  # noqa: T201
    return 1 if failed else 0


def _results(
    jobs: Sequence[EpisodeJob], setting: Setting, arguments: argparse.Namespace
) -> list[EpisodeRecord | FailedEpisode]:
    """What became of every job, in this run or, where rows were kept, in an earlier one."""
    from tqdm import tqdm

    from packenv.io.rows import RowFile

    from .running import EpisodeRecord, record_row, run_episodes

    rows = None if arguments.out is None else RowFile(arguments.out)
    wanted = {job.key for job in jobs}
    results: dict[str, EpisodeRecord | FailedEpisode] = {
        row["key"]: EpisodeRecord.of_row(row) for row in rows or () if row["key"] in wanted
    }
    missing = [job for job in jobs if job.key not in results]
    episodes = run_episodes(missing, setting, workers=arguments.workers)
    bar = {"total": len(jobs), "initial": len(results), "unit": "episode", "file": sys.stderr}
    for key, result in tqdm(episodes, disable=None, leave=False, **bar):
        results[key] = result
        # What failed has no row: the next run tries it again.
        if rows is not None and isinstance(result, EpisodeRecord):
            rows.append(record_row(key, result))
    return list(results.values())


def _agent_options(
    arguments: argparse.Namespace, config: Mapping[str, object] | None
) -> dict[str, Mapping[str, object]]:
    """The options of every agent that is named, by its name."""
    names = [name.strip() for name in arguments.agent.split(",")]
    for name in names:
        check_name(name)
        if names.count(name) > 1:
            raise InputError(f"--agent {arguments.agent}: names {name} more than once")
    if "learned" in names and arguments.weights is None:
        raise InputError("agent learned: needs --weights DIR, a folder that python -m packenv.train wrote")
    if "learned" not in names and (arguments.weights is not None or arguments.trust):
        raise InputError("--weights and --trust: are for the agent learned, which --agent does not name")
    own: dict[str, Mapping[str, object]] = {
        "learned": {"weights": arguments.weights, "trust": arguments.trust},
        "gls": {"config": config},
    }
    return {name: own.get(name, {}) for name in names}


def _document(text: str | None, option: str) -> dict[str, object] | None:
    return None if text is None else read_document(text, option)


if __name__ == "__main__":
    sys.exit(main())
