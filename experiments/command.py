"""``robotpack bench``: run experiments, merge shards, report."""

from __future__ import annotations

from . import one_thread  # noqa: F401  isort: skip

import argparse
import shlex
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from packenv import api
from packenv.cli.bench import EXPERIMENTS
from packenv.cli.output import Terminal, remark, say, say_json
from packenv.errors import InputError
from packenv.io.containers import parse_container, read_boxes
from packenv.io.rows import read_rows
from packenv.items.plan_items import Items
from packenv.planning.assembly import heuristic_of
from packenv.planning.options import PlanOptions
from packenv.types import Plan

from .columns import chosen
from .experiment import Experiment, Job, Row
from .folder import RunFolder, Shard, merge_rows
from .planning import GLS
from .registry import experiment
from .report import text_table, write_report
from .results import Result
from .revision import revision
from .runner import Finished, Pool, alone, finish
from .setting import options_of
from .spec import RunSpec
from .words import USES, commands_of, unused

if TYPE_CHECKING:
    from packenv.execution.execute import ExecutedPlan


def run(arguments: argparse.Namespace) -> int:
    """Do what the user asked for; returns the exit code: 1 where a job broke or a plan failed its audit."""
    if arguments.action == "figures":
        return _figures(arguments)
    if arguments.action == "merge":
        return _merge(arguments)
    if arguments.action == "report":
        return _report(arguments, RunFolder(arguments.out))
    return _run(arguments)


def _run(arguments: argparse.Namespace) -> int:
    spec = spec_of(arguments)
    pool = _pool(arguments)
    shard = _shard(arguments.shard)
    folder = RunFolder(arguments.out)
    names = list(EXPERIMENTS) if arguments.action == "all" else [arguments.action]
    wanted = [experiment(name) for name in names]
    if len(names) == 1 and (useless := unused(names[0], spec)):
        remark(f"{names[0]} has no use for {', '.join(useless)}")
    any_revision = arguments.any_revision
    try:
        done = [_finished(e, spec, folder, pool, shard, any_revision=any_revision) for e in wanted]
    except KeyboardInterrupt:
        remark(f"stopped; the rows are in {folder.path}, and the same command goes on from there")
        raise
    return _tell(arguments, folder, done, part=shard.count > 1)


@dataclass(frozen=True)
class _Done:
    """An experiment, its rows and what they say."""

    result: Result
    rows: Sequence[Row]
    jobs: Sequence[Job]
    new: int
    each: Experiment


def _finished(
    each: Experiment,
    spec: RunSpec,
    folder: RunFolder,
    pool: Pool,
    shard: Shard,
    *,
    any_revision: bool,
    only_read: str | None = None,
) -> _Done:
    """Do an experiment, or with a revision only read the rows of that one."""
    each.prepare(spec, str(folder.path))
    wanted = each.jobs(spec)
    if spec.methods and "methods" in USES[each.name] and not _any_asked_for(spec, wanted):
        settings = f" with --settings {' '.join(spec.settings)}" if spec.settings else ""
        remark(
            f"{each.name}: has no job for --methods {' '.join(spec.methods)}{settings}; the paper's preset is run with "
            "the paper's methods, and small orders without gls"
        )
    jobs = [job for job in wanted if job.index in shard]
    found = finish(
        each.work,
        jobs,
        out=folder.rows(each.rows, shard),
        pool=pool,
        timeout=each.timeout,
        prepare=each.prepare,
        arguments=(spec, str(folder.path)),
        revision=only_read or revision(each.work),
        head=Job.head,
        any_revision=any_revision,
        only_read=only_read is not None,
        begin=lambda: folder.keep_spec(each.name, spec),
        what=each.name,
    )
    _say_of_others(each.name, found, any_revision=any_revision)
    result = replace(each.summarize(spec, found.rows), missing=found.missing)
    return _Done(result, found.rows, jobs, found.new, each)


def _any_asked_for(spec: RunSpec, jobs: Sequence[Job]) -> bool:
    """Whether a method that is named is run in a setting that is named: witnesses of feasibility are others."""
    return any(job.method in spec.methods and job.setting in (spec.settings or [job.setting]) for job in jobs)


def _say_of_others(name: str, found: Finished, *, any_revision: bool) -> None:
    if found.others:
        told = ", ".join(f"{n} of {other}" for other, n in sorted(found.others.items()))
        what = "counted, too" if any_revision else "not counted (--any-revision counts them)"
        remark(f"{name}: rows of other revisions of the product, {what}: {told}")


def _merge(arguments: argparse.Namespace) -> int:
    sources = [RunFolder(path) for path in arguments.folders]
    target = RunFolder(arguments.out)
    specs: dict[str, RunSpec] = {}
    for source in sources:
        found = source.specs()
        if not found:
            raise InputError(f"{source.path}: holds no run, give folders that robotpack bench wrote")
        for name, spec in found.items():
            if specs.setdefault(name, spec) != spec:
                raise InputError(
                    f"{source.path}: {name} was asked for with other words than in another folder, "
                    "give shards of one run"
                )
    kinds = {experiment(name).rows for name in specs}
    with ExitStack() as stack:  # a run that writes there would lose what it writes meanwhile
        for kind in sorted(kinds):
            stack.enter_context(alone(target.rows(kind)))
        for name, spec in specs.items():
            target.keep_spec(name, spec)
        for kind in sorted(kinds):
            files = [path for folder in dict.fromkeys([*sources, target]) for path in folder.row_files(kind)]
            if files:
                merge_rows(list(dict.fromkeys(path.resolve() for path in files)), target.rows(kind))
    return _report(arguments, target)


def _report(arguments: argparse.Namespace, folder: RunFolder) -> int:
    """Table and report of the rows that are there."""
    specs = folder.specs()
    if not specs:
        raise InputError(f"{folder.path}: holds no run, give a folder that robotpack bench wrote")
    names = [*(name for name in EXPERIMENTS if name in specs), *(n for n in specs if n not in EXPERIMENTS)]
    done = []
    for name in names:
        each = experiment(name)
        own = _revision_of(folder, each, any_revision=arguments.any_revision)
        pool = Pool("serial")
        done.append(
            _finished(
                each, specs[name], folder, pool, Shard(), any_revision=arguments.any_revision, only_read=own
            )
        )
    return _tell(arguments, folder, done)


def _revision_of(folder: RunFolder, each: Experiment, *, any_revision: bool) -> str:
    """The revision of the rows of a folder; of several that of the last row, of none yet ``""``.

    Raises:
        InputError: they are of several, and that was not asked for; or of shards that are not merged.
    """
    path = folder.rows(each.rows)
    if not path.exists():
        if folder.row_files(each.rows):
            merge = shlex.join(["robotpack", "bench", "merge", str(folder.path), "--out", str(folder.path)])
            raise InputError(f"{path}: does not exist, merge its shards: {merge}")
        return ""
    found = [str(row.get("revision")) for row in read_rows(path)]
    if len(set(found)) > 1 and not any_revision:
        told = ", ".join(sorted(set(found)))
        raise InputError(f"{path}: has rows of several revisions ({told}), give --any-revision to mix them")
    return found[-1] if found else ""


def _tell(
    arguments: argparse.Namespace, folder: RunFolder, done: Sequence[_Done], *, part: bool = False
) -> int:
    """Print results; keep them and write the report, but of a part, which would stand for the whole there."""
    results = [each.result for each in done]
    if not part:
        for result in results:
            folder.keep_result(result)
    if arguments.json:
        rows = [{"experiment": r.experiment, **row} for r in results for row in r.to_json()["rows"]]
        document = results[0].to_json() if len(results) == 1 else {"results": [r.to_json() for r in results]}
        say_json({**document, "rows": rows, "missing_jobs": sum(r.missing for r in results)})
    else:
        for each in done:
            say(text_table(each.result))
            say()
    for each in done:
        if each.result.missing:
            remark(f"{each.result.experiment}: {each.result.missing} jobs have no row yet")
        for failure in each.result.failures:
            if failure.why.startswith("job "):
                remark(f"{each.result.experiment}: {failure.method}, order {failure.index}: {failure.why}")
    if part and not arguments.no_report:
        remark(f"this is shard {arguments.shard}: robotpack bench merge writes the report of all")
    elif not arguments.no_report:
        _write_report(folder, done, anew=arguments.action in ("merge", "report"))
    broken = sum(result.broken + result.missing for result in results)
    findings = sum(
        int(row.get(name, 0))
        for each in done
        for row in each.rows
        for name in ("overlaps", "protrusions", "blocked")
    )
    return 1 if broken or findings else 0


@dataclass(frozen=True)
class _PlansAgain:
    """Plans of rows, for a report: of each experiment its jobs by key, and what makes one's plan again."""

    catalogue: Items
    jobs: Mapping[str, Mapping[str, Job]]
    again: Mapping[str, Callable[[Job], Plan | ExecutedPlan]]

    def plan_of(self, experiment: str, row: Row) -> Plan | ExecutedPlan:
        """The plan of a row, made again."""
        return self.again[experiment](self.jobs[experiment][row["key"]])


def _write_report(folder: RunFolder, done: Sequence[_Done], *, anew: bool) -> None:
    """Write the report, unless it is there and no row is new."""
    page = folder.path / "report.html"
    if page.exists() and not anew and not any(each.new for each in done):
        return
    named = {each.result.experiment: each for each in done}
    specs = {name: each.result.spec for name, each in named.items()}
    spec = done[0].result.spec
    pictures = _PlansAgain(
        api.load_catalogue(spec.catalogue, unit=spec.unit),
        {name: {job.key: job for job in each.jobs} for name, each in named.items()},
        {name: each.each.again for name, each in named.items()},
    )
    try:
        write_report(
            folder.path,
            [_told_of_pictures(each) for each in done],
            {name: each.rows for name, each in named.items()},
            pictures,
            command="\n".join(commands_of(specs, folder.path)),
            watcher=Terminal(),
        )
    except InputError as problem:  # the rows are there, and the table was printed
        remark(f"no report: {problem}")
    else:
        remark(f"wrote {page} and {page.with_suffix('.md')}")


def _told_of_pictures(done: _Done) -> Result:
    """The result, and in it where plans that are shown are not those of the rows."""
    now = revision(done.each.work)
    if set(done.result.revisions) <= {now}:
        return done.result
    told = f"Plans that are shown were made again by revision {now}, which may plan otherwise than the rows tell."
    return replace(done.result, remarks=(*done.result.remarks, told))


def _figures(arguments: argparse.Namespace) -> int:
    """The paper's figures."""
    from .figures import write_figures

    made = write_figures(
        arguments.catalogue,
        arguments.out,
        unit=arguments.unit,
        seed=arguments.seed,
        engine=arguments.engine,
        watcher=Terminal(),
    )
    for figure in made:
        say(f"{figure.title} (the paper: {figure.paper})")
        for path in figure.files:
            say(f"  {path}")
    return 0


def spec_of(arguments: argparse.Namespace) -> RunSpec:
    """What the user asks for.

    Raises:
        InputError: a method, a setting, a column or the container is wrong.
    """
    for method in arguments.methods:
        if method != GLS:
            heuristic_of(PlanOptions(heuristic=method))
    for setting in arguments.settings:
        if options_of(setting).search == "5d" and arguments.action in ("search5d", "all"):
            raise InputError(
                f"setting {setting!r:.60}: search5d adds search=5d itself, give the setting without it"
            )
    chosen(arguments.columns)
    return RunSpec(
        catalogue=arguments.catalogue,
        unit=arguments.unit,
        orders=arguments.orders,
        seed=arguments.seed,
        items=arguments.items,
        container=parse_container(arguments.container, read_boxes()).size,
        methods=tuple(arguments.methods),
        constraints=tuple(arguments.constraints),
        settings=tuple("".join(setting.split()) for setting in arguments.settings),
        gls_plans=arguments.gls_plans,
        unseen=arguments.unseen,
        columns=tuple(arguments.columns),
        engine=arguments.engine,
    )


def _pool(arguments: argparse.Namespace) -> Pool:
    backend, hint = arguments.backend, ""
    if arguments.ray_address is not None and backend != "ray":
        raise InputError(f"--ray-address: is for --backend ray, which --backend {backend} is not")
    if backend == "auto":
        from importlib.util import find_spec

        backend = "pebble" if find_spec("pebble") else "serial"
        hint = "; worker processes need pebble: pip install 'robotpack[bench]'"
    if backend == "serial" and (arguments.workers or 1) > 1:
        remark(f"--workers {arguments.workers}: all jobs are done in this process, one after another{hint}")
    workers = arguments.workers or (None if arguments.ray_address else 1)
    return Pool(backend, workers, arguments.ray_address, arguments.timeout)


def _shard(text: str | None) -> Shard:
    try:
        return Shard() if text is None else Shard.parse(text)
    except ValueError:
        raise InputError(f"--shard {text}: is no part of a whole, give I/N such as 2/8") from None
