"""Speed of ``RobotPack-v0``: ``python -m benchmarks.env [--catalogue DIR] [--steps 150] [--json]``.

An HM agent plays random 10-item orders in one process with one thread. For each mode (``legal``, ``stable``,
``robot``: planning alone at that mask; ``physics``: mask ``robot`` in PyBullet with the arm) orders are
played until ``--steps`` steps are timed. Items are loaded and code is compiled before. JSON keys:

- ``steps_per_s``, by mode: one over the median CPU-seconds of a step;
- ``cpu_s_per_step``, by mode: the median; ``cpu_s_per_step_mean``: the mean, which rare hard items drive up;
- ``wall_s_per_step``, by mode: median seconds by the clock: on a busy machine far more than the CPU time;
- ``steps``, ``items_packed_share``, by mode: how many steps, and what the agent packed;
- ``reset_ms``: median CPU-milliseconds of a reset with mask ``robot`` once the catalogue is in memory: it
  searches and checks the first item's candidates; ``reset_alone_ms``: the same at mask ``legal``;
- ``rss_mb``: resident memory of a fresh process that played mask ``robot`` for ``--steps`` steps, every item
  of the catalogue loaded; ``uss_mb``: what of it is its own, shared libraries left out;
- ``two_process_ratio``: steps by the clock of two processes at once over those of one, at mask ``robot``;
- ``profile``, by mode: share of the CPU time of a step by part, measured with a clock around each, a part
  without the parts inside it; ``other`` is what is left.
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import functools
import json
import multiprocessing
import statistics
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import psutil
from tqdm import tqdm

from packenv.env import candidate_set, episode
from packenv.env.observation import FEATURES, Observer
from packenv.env.pack_env import PackEnv
from packenv.env.physical_arrangement import PhysicalArrangement
from packenv.items.catalogue import open_catalogue
from packenv.planning.manipulation.constraint import ManipulationConstraint
from packenv.planning.search import heuristics as scores
from packenv.planning.stability import (
    checker as stability,
    constraint as stability_constraint,
    solvers as equilibrium_solvers,
)
from packenv.planning.stability.constraint import StabilityConstraint
from packenv.sim.session import Session

MODES: dict[str, dict[str, Any]] = {
    "legal": {"mask": "legal"},
    "stable": {"mask": "stable"},
    "robot": {"mask": "robot"},
    "physics": {"mask": "robot", "physics": True},
}

PARTS: tuple[tuple[Any, str, str], ...] = (
    (candidate_set, "grid_search", "search"),
    (scores, "_gather", "scores"),
    (candidate_set, "_ranks", "ranks"),
    (candidate_set, "_chosen", "choice"),
    (stability_constraint, "item_contacts", "contacts"),
    (stability_constraint, "thin", "contacts"),
    (stability, "solve_nnls", "balance"),
    (stability, "solve_highs", "balance"),
    (stability, "build_equilibrium", "equations"),
    (equilibrium_solvers, "_last_resort", "balance"),
    (StabilityConstraint, "check", "stability, rest"),
    (ManipulationConstraint, "check", "manipulation"),
    (Observer, "observe", "observation"),
    (Session, "place", "engine"),
    (PhysicalArrangement, "_measured", "measured map"),
    (episode, "perturbations", "perturbed maps"),
)
"""Functions and methods, and the parts of a step that they are."""


class Clock:
    """CPU time by part; what a part calls that is a part itself counts for that one alone."""

    def __init__(self) -> None:
        """Nothing spent."""
        self.spent: Counter[str] = Counter()
        self._inner = [0.0]

    @contextmanager
    def around(self, parts: Sequence[tuple[Any, str, str]]) -> Iterator[None]:
        """Time these functions while the context lasts."""
        kept = [(owner, name, getattr(owner, name)) for owner, name, _ in parts]
        for (owner, name, part), (_, _, function) in zip(parts, kept, strict=True):
            setattr(owner, name, self._timed(function, part))
        try:
            yield
        finally:
            for owner, name, function in kept:
                setattr(owner, name, function)

    def _timed(self, function: Callable[..., Any], part: str) -> Callable[..., Any]:
        @functools.wraps(function)
        def timed(*args: Any, **kwargs: Any) -> Any:
            self._inner.append(0.0)
            start = time.process_time()
            try:
                return function(*args, **kwargs)
            finally:
                whole = time.process_time() - start
                self.spent[part] += whole - self._inner.pop()
                self._inner[-1] += whole

        return timed


def greedy(obs: dict[str, np.ndarray]) -> int:
    """The valid candidate of the smallest HM rank."""
    ranks = np.where(obs["action_mask"][:-1], obs["candidates"][:, FEATURES.index("rank_hm")], np.inf)
    return int(ranks.argmin()) if np.isfinite(ranks.min()) else len(ranks)


class Player:
    """Plays episodes in one environment; seeds go on where the last call stopped."""

    def __init__(self, catalogue: str, mode: str) -> None:
        """Make the environment, and load every item."""
        self.env = PackEnv({"catalogue": catalogue, **MODES[mode]})
        self.seed = 0
        for name in open_catalogue(catalogue).names:
            self.env._shelf.prepared[name]
        self.play(3)

    def play(self, steps: int, *, bar: str | None = None) -> dict[str, list[float]]:
        """Play until so many steps are done; CPU and wall seconds of each, and of each reset."""
        times: dict[str, list[float]] = {"cpu": [], "wall": [], "reset": [], "packed": []}
        with tqdm(total=steps, desc=bar, disable=None if bar else True) as progress:
            while len(times["cpu"]) < steps:
                start = time.process_time()
                obs, info = self.env.reset(seed=self.seed)
                times["reset"].append(time.process_time() - start)
                self.seed += 1
                ended = False
                while not ended:
                    action = greedy(obs)
                    wall, start = time.perf_counter(), time.process_time()
                    obs, _, terminated, truncated, info = self.env.step(action)
                    times["cpu"].append(time.process_time() - start)
                    times["wall"].append(time.perf_counter() - wall)
                    progress.update()
                    ended = terminated or truncated
                total = info["packed_items"] + info["items_left"] + len(info["left_over"])
                times["packed"].append(info["packed_items"] / total)
        return times


def in_a_process(catalogue: str, steps: int, ready: Any, go: Any, told: Any) -> None:
    """Play in a process of its own, and tell seconds a step and memory."""
    player = Player(catalogue, "robot")
    ready.release()
    go.wait()
    start = time.perf_counter()
    done = len(player.play(steps)["cpu"])
    rate, memory = done / (time.perf_counter() - start), psutil.Process().memory_full_info()
    told.put((rate, memory.rss / 1e6, memory.uss / 1e6))


def processes(catalogue: str, steps: int, count: int) -> tuple[float, float, float]:
    """Steps a second of so many processes together, and the largest memory, all and own, MB."""
    context = multiprocessing.get_context("spawn")
    ready, go, told = context.Semaphore(0), context.Event(), context.Queue()
    workers = [
        context.Process(target=in_a_process, args=(catalogue, steps, ready, go, told)) for _ in range(count)
    ]
    for worker in workers:
        worker.start()
    for _ in workers:
        ready.acquire()
    go.set()
    answers = [told.get() for _ in workers]
    for worker in workers:
        worker.join()
    rates, memories, own = zip(*answers, strict=True)
    return sum(rates), max(memories), max(own)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--catalogue", default="builtin")
    parser.add_argument("--steps", type=int, default=150, help="steps a mode (default: %(default)s)")
    parser.add_argument("--modes", nargs="+", choices=tuple(MODES), default=list(MODES))
    parser.add_argument("--json", action="store_true", help="JSON only, no table")
    arguments = parser.parse_args()
    rows: dict[str, dict[str, Any]] = {}
    resets: dict[str, float] = {}
    for mode in arguments.modes:
        player = Player(arguments.catalogue, mode)
        times = player.play(arguments.steps, bar=mode)
        resets[mode] = 1e3 * statistics.median(times["reset"])
        clock = Clock()
        with clock.around(PARTS):
            start = time.process_time()
            player.play(max(20, arguments.steps // 3), bar=f"{mode}, by part")
            whole = time.process_time() - start
        shares = {part: seconds / whole for part, seconds in clock.spent.most_common()}
        rows[mode] = {
            "steps_per_s": 1.0 / statistics.median(times["cpu"]),
            "cpu_s_per_step": statistics.median(times["cpu"]),
            "cpu_s_per_step_mean": statistics.mean(times["cpu"]),
            "wall_s_per_step": statistics.median(times["wall"]),
            "steps": len(times["cpu"]),
            "items_packed_share": statistics.mean(times["packed"]),
            "profile": {**shares, "other": 1.0 - sum(shares.values())},
        }
        player.env.close()
    one, memory, own = processes(arguments.catalogue, arguments.steps, 1)
    two, _, _ = processes(arguments.catalogue, arguments.steps, 2)
    report = {
        "catalogue": arguments.catalogue,
        **{key: {mode: row[key] for mode, row in rows.items()} for key in next(iter(rows.values()))},
        "reset_ms": resets.get("robot"),
        "reset_alone_ms": resets.get("legal"),
        "rss_mb": memory,
        "uss_mb": own,
        "two_process_ratio": two / one,
    }
    if not arguments.json:
        for mode, row in rows.items():
            parts = ", ".join(f"{part} {share:.0%}" for part, share in list(row["profile"].items())[:6])
            print(
                f"{mode:<8} {row['steps_per_s']:7.1f} steps/s  {row['cpu_s_per_step']:.3f} CPU-s  {parts}",
                file=sys.stderr,
            )
    print(json.dumps(report, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
