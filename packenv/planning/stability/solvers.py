"""Are there forces that balance the pile? Three solvers, one meaning.

``stable`` means: forces were found that pass :meth:`Equilibrium.balanced`. ``unstable`` means: a motion was
found that passes :meth:`Equilibrium.refuted_by`, so no forces exist. Each solver's answer is put to that
test, whatever the solver says of itself; what passes neither is asked again another way, and only where all
ways fail the answer is ``undecided``, which no caller may take for "stable".
"""

from __future__ import annotations

import importlib
import threading
import warnings
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from packenv.planning.stability.equilibrium import Equilibrium, tangents
from packenv.planning.stability.equilibrium_kernels import least_squares
from packenv.quiet import engine_muted
from packenv.types import FloatArray, IntArray

Status = Literal["stable", "unstable", "undecided"]


@dataclass(frozen=True, eq=False)
class Solution:
    """What a solver found.

    Attributes:
        status: ``stable``, ``unstable``, or ``undecided`` where no solver could prove either.
        solver: who answered.
        forces: (k, 3) N, on the second body of each contact of the equilibrium; None unless stable.
        x: (k · sides,) the same as coefficients of the pyramids' edges, without unit; None unless stable.
        motion: (6 n,) how the items begin to move, in row units, summing to 1 in size; None unless a proof of
            instability was found.
    """

    status: Status
    solver: str
    forces: FloatArray | None = None
    x: FloatArray | None = None
    motion: FloatArray | None = None

    @property
    def basis(self) -> IntArray:
        """Columns that carry force: what :func:`solve_highs` may start from the next time."""
        return np.empty(0, dtype=np.int64) if self.x is None else np.flatnonzero(self.x)


def _judge(eq: Equilibrium, solver: str, x: FloatArray | None, ray: FloatArray | None) -> Solution:
    """Turn what a solver returned into an answer, if it passes the test of :class:`Equilibrium`."""
    if x is not None:
        # Simplex may leave a coefficient a rounding error below zero.
        x = np.where((x < 0.0) & (x > -1e-8), 0.0, x)
        if eq.balanced(x):
            return Solution("stable", solver, forces=eq.forces(x), x=x)
    if ray is not None and eq.refuted_by(ray):
        return Solution("unstable", solver, motion=ray / np.abs(ray).sum())
    return Solution("undecided", solver)


def solve_nnls(eq: Equilibrium) -> Solution:
    """Non-negative least squares (Lawson and Hanson): the fastest for up to three items.

    The residual of the best fit is itself the motion that proves instability.
    """
    answer = _fit(eq)
    return answer if answer.status != "undecided" else solve_highs(eq)


def _fit(eq: Equilibrium) -> Solution:
    """Non-negative least squares alone; undecided where it proves nothing."""
    if not eq.n_columns:
        return _judge(eq, "nnls", np.empty(0), eq.rhs)
    # Every column of a single item is full.
    columns = eq.value.reshape(-1, 6) if eq.n_rows == 6 else np.ascontiguousarray(eq.dense.T)
    x, left = np.empty(eq.n_columns), np.empty(eq.n_rows)
    if not least_squares(columns, eq.rhs, 3 * eq.n_columns, x, left):
        return Solution("undecided", "nnls")
    return _judge(eq, "nnls", x, left)


def solve_highs(eq: Equilibrium, warm: IntArray | None = None) -> Solution:
    """Least sum of what is left unbalanced, by HiGHS' simplex and some of the columns.

    This linear program always has a solution, so no run hangs on the tolerances of a proof that it has none, which is
    where simplex is weakest (docs/decisions.md). Its multipliers are a motion; the columns that could resist it
    join, until nothing is left unbalanced or no column resists. The answer is the whole program's, and most columns are
    never looked at.

    Args:
        eq: the question.
        warm: columns to begin with, e.g. those that carry force in the pile without its newest item; all of a few, or
            none of many, where None.
    """
    if not eq.n_columns:
        return _judge(eq, "highs", np.empty(0), eq.rhs)
    if eq.n_columns <= _FEW_COLUMNS:
        warm = np.arange(eq.n_columns)
    for options in _ATTEMPTS:
        answer = _by_columns(eq, np.empty(0, dtype=np.int64) if warm is None else np.unique(warm), options)
        if answer.status != "undecided":
            return answer
    answer = _fit(eq) if eq.n_rows <= _DENSE_ROWS else solve_clarabel(eq)
    return answer if answer.status != "undecided" else _last_resort(eq)


_ATTEMPTS: tuple[dict[str, Any], ...] = ({}, {"simplex_scale_strategy": 4}, {"simplex_strategy": 1})
"""HiGHS' options, one set a try: primal simplex unscaled, scaled, dual simplex."""

_FEW_COLUMNS = 64
"""Up to so many columns all take part from the start."""

_DENSE_ROWS = 60
"""Up to so many rows dense least squares takes less time than an interior point."""

_DEFAULTS: dict[str, Any] = {
    "output_flag": False,
    "threads": 1,
    "presolve": "off",
    "solver": "simplex",
    "primal_feasibility_tolerance": 1e-9,
    "dual_feasibility_tolerance": 1e-9,
    # Equilibrium's rows and columns are balanced already: scaling costs time and changes nothing.
    "simplex_scale_strategy": 0,
    "simplex_strategy": 4,
    # A run takes hundreds of iterations, or stalls; a stalled one is undecided and asked again another way.
    "simplex_iteration_limit": 5000,
}

_ENTERING = 200
"""Most columns that join at once."""

_RESISTING = 1e-9
"""Work of a column, against a motion of at most 1 in each row, up to which it does not resist."""

_ROUNDS = 100
"""Most times that columns join before the question is asked another way."""

_local = threading.local()


def _last_resort(eq: Equilibrium) -> Solution:
    """Ask the reference where it is installed."""
    try:
        return solve_cvxpy(eq)
    except ImportError:
        return Solution("undecided", "highs")


def highs_solver() -> Any:
    """This thread's HiGHS object; making one costs 0.2 ms."""
    solver = getattr(_local, "highs", None)
    if solver is None:
        solver = _local.highs = new_solver()
    return solver


def new_solver() -> Any:
    """A HiGHS object of one's own, with RobotPack's options."""
    solver = _silent_highs()
    for name, value in _DEFAULTS.items():
        solver.setOptionValue(name, value)
    return solver


def _silent_highs() -> Any:
    """A HiGHS object that prints nothing, not even when it is made.

    From 1.16 on, HiGHS tells its version on standard output as soon as its callbacks are set up, which
    the constructor does before anybody can set an option.
    """
    from highspy import Highs

    base: Any = Highs  # its methods have no annotations

    class Silent(base):  # type: ignore[misc]
        def enableCallbacks(self) -> None:  # noqa: N802
            self.setOptionValue("output_flag", False)
            super().enableCallbacks()

    return Silent()


def pass_program(
    highs: Any, eq: Equilibrium, start: Any, index: Any, value: FloatArray, *, cost: FloatArray | None = None
) -> None:
    """Give HiGHS the rows of ``eq`` with the columns (start, index, value), all of them non-negative.

    Args:
        highs: the solver; what it held is forgotten.
        eq: rows and tolerance.
        start: (c + 1,) int32 where the columns begin.
        index: int32 rows.
        value: entries.
        cost: (c,) of the columns, whose sum is made as small as possible; only feasibility is asked where None.
    """
    columns = len(start) - 1
    cost = np.zeros(columns) if cost is None else cost
    highs.passModel(
        columns,
        eq.n_rows,
        len(value),
        _COLUMN_WISE,
        _MINIMISE,
        0.0,
        cost,
        np.zeros(columns),
        np.full(columns, np.inf),
        eq.rhs - eq.tolerance,
        eq.rhs + eq.tolerance,
        start,
        index,
        value,
        np.zeros(columns, dtype=np.int32),
    )


_COLUMN_WISE, _MINIMISE = 1, 1
"""HiGHS' MatrixFormat.kColwise and ObjSense.kMinimize, as passModel takes them."""


def _by_columns(eq: Equilibrium, chosen: IntArray, options: dict[str, Any]) -> Solution:
    """Begin with the columns ``chosen``; let those join that resist the motion found.

    Args:
        eq: the question.
        chosen: columns, ascending.
        options: of HiGHS that are changed.
    """
    highs = highs_solver()
    for name, value in options.items():
        highs.setOptionValue(name, value)
    try:
        return _grow(highs, eq, chosen)
    finally:
        for name in options:
            highs.setOptionValue(name, _DEFAULTS[name])


def _grow(highs: Any, eq: Equilibrium, chosen: IntArray) -> Solution:
    """See :func:`_by_columns`."""
    import highspy

    rows = eq.n_rows
    start, index, value = eq.columns(chosen)
    # What is left unbalanced, upwards and downwards, are columns of their own, and cost.
    own = np.arange(rows)
    start = np.concatenate([np.arange(2 * rows), 2 * rows + start]).astype(np.int32)
    index = np.concatenate([own, own, index]).astype(np.int32)
    value = np.concatenate([np.ones(rows), -np.ones(rows), value])
    cost = np.concatenate([np.ones(2 * rows), np.zeros(len(chosen))])
    pass_program(highs, eq, start, index, value, cost=cost)
    for _ in range(_ROUNDS):
        highs.run()
        if highs.getModelStatus() != highspy.HighsModelStatus.kOptimal:
            break
        solution = highs.getSolution()
        x = np.asarray(solution.col_value)
        full = np.zeros(eq.n_columns)
        full[chosen] = x[2 * rows :]
        if not x[: 2 * rows].any():
            answer = _judge(eq, "highs", full, None)
            if answer.status != "undecided":
                return answer
        motion = np.asarray(solution.row_dual)
        resisting = eq.work(motion)
        resisting[chosen] = 0.0
        entering = np.flatnonzero(resisting > _RESISTING)
        if not len(entering):
            return _judge(eq, "highs", full, motion)
        if len(entering) > _ENTERING:
            entering = entering[np.argpartition(resisting[entering], -_ENTERING)[-_ENTERING:]]
        start, index, value = eq.columns(entering)
        n = len(entering)
        highs.addCols(n, np.zeros(n), np.zeros(n), np.full(n, np.inf), len(value), start[:-1], index, value)
        chosen = np.concatenate([chosen, entering])
    return Solution("undecided", "highs")


def solve_clarabel(eq: Equilibrium) -> Solution:
    """Non-negative least squares by a sparse interior point, for piles that are too large for :func:`solve_nnls`."""
    clarabel: Any = importlib.import_module("clarabel")
    from scipy.sparse import block_array, csc_array, eye_array

    rows, columns = eq.n_rows, eq.n_columns
    left = eye_array(rows)
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    settings.tol_feas, settings.tol_gap_abs, settings.tol_gap_rel = 1e-9, 1e-14, 1e-9
    solver = clarabel.DefaultSolver(
        csc_array(block_array([[csc_array((columns, columns)), None], [None, left]])),
        np.zeros(columns + rows),
        csc_array(block_array([[eq.matrix, left], [-eye_array(columns), None]])),
        np.concatenate([eq.rhs, np.zeros(columns)]),
        [clarabel.ZeroConeT(rows), clarabel.NonnegativeConeT(columns)],
        settings,
    )
    found = np.asarray(solver.solve().x)
    return _judge(eq, "clarabel", np.maximum(found[:columns], 0.0), found[columns:])


def solve_cvxpy(eq: Equilibrium, first: str = "HIGHS") -> Solution:
    """The reference: the paper's conditions for CVXPY, written item by item and contact by contact.

    It shares no matrix with the fast solvers. Variables are the forces, the pyramid is given by its
    faces instead of its edges, and the balance is eqs. 1 and 2 of the paper. "Infeasible" is taken from the
    solver's word; where a solver fails or calls its own answer inaccurate, the next one is asked.

    Args:
        eq: the question.
        first: CVXPY's name of the solver that is asked first: HIGHS, CLARABEL or SCS.
    """
    cp: Any = importlib.import_module("cvxpy")  # partly annotated

    if not len(eq.contacts):
        return _judge(eq, "cvxpy", np.empty(0), eq.rhs)
    if not eq.n_rows:
        return _judge(eq, "cvxpy", np.zeros(eq.n_columns), None)
    force = cp.Variable(3 * len(eq.contacts))  # contact after contact, in units of eq.units
    left = _balance(eq) @ force - eq.rhs
    problem = cp.Problem(
        cp.Minimize(0.0), [_faces(eq) @ force >= 0.0, left <= eq.tolerance, left >= -eq.tolerance]
    )
    for name, options in sorted(_REFERENCE_SOLVERS, key=lambda solver: solver[0] != first):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an inaccurate answer is seen in its status
            try:
                with engine_muted():  # CVXPY makes a HiGHS of its own, which tells its version
                    problem.solve(solver=name, **options)
            except (cp.SolverError, ValueError):
                continue
        solver = f"cvxpy/{name}"
        if problem.status == cp.OPTIMAL:
            answer = _check_forces(eq, force.value.reshape(-1, 3) * eq.units[:, None], solver)
            if answer.status == "stable":
                return answer
        elif problem.status == cp.INFEASIBLE:
            return Solution("unstable", solver)
    return Solution("undecided", "cvxpy")


_REFERENCE_SOLVERS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("HIGHS", {"primal_feasibility_tolerance": 1e-9}),
    ("CLARABEL", {"tol_feas": 1e-9}),
    ("SCS", {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iters": 100_000}),
)


def _faces(eq: Equilibrium) -> Any:
    """Paper eqs. 3 and 4 as a sparse matrix: forces push, friction stays inside each face."""
    from scipy.sparse import block_diag, coo_array, csr_matrix

    first, second = tangents(eq.contacts.normals, eq.up)
    inner = eq.mu * np.cos(np.pi / eq.sides)
    faces = 2.0 * np.pi * (np.arange(eq.sides) + 0.5) / eq.sides
    blocks = [
        coo_array(np.vstack([n, m * n - np.outer(np.cos(faces), t) - np.outer(np.sin(faces), u)]))
        for m, n, t, u in zip(inner, eq.contacts.normals, first, second, strict=True)
    ]
    return csr_matrix(block_diag(blocks))


def _balance(eq: Equilibrium) -> FloatArray:
    """Paper eqs. 1 and 2: what each contact's force adds to the balance of each free item, (6 n, 3 k)."""
    contacts = eq.contacts
    total = np.zeros((len(eq.free), 6, len(contacts), 3))
    for i, body in enumerate(eq.free):
        for k in range(len(contacts)):
            sign = float(contacts.second[k] == body) - float(contacts.first[k] == body)
            if sign:
                scale = sign * eq.units[k] / eq.weights[i]
                total[i, :3, k] = scale * np.eye(3)
                total[i, 3:, k] = scale * _crossing((contacts.points[k] - eq.coms[i]) / eq.length)
    return total.reshape(6 * len(eq.free), -1)


def _crossing(arm: FloatArray) -> FloatArray:
    """(3, 3) matrix of "arm ×"."""
    x, y, z = arm
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _check_forces(eq: Equilibrium, forces: FloatArray, solver: str) -> Solution:
    """Write forces as combinations of the pyramids' edges, and put them to the common test."""
    scaled = forces / eq.units[:, None]
    normal = np.einsum("ij,ij->i", scaled, eq.contacts.normals)
    t1, t2 = tangents(eq.contacts.normals, eq.up)
    u, v = np.einsum("ij,ij->i", scaled, t1), np.einsum("ij,ij->i", scaled, t2)
    step = 2.0 * np.pi / eq.sides
    left = np.floor(np.arctan2(v, u) / step)
    # In the plane, the two edges beside the tangential force: p e(left) + q e(left + 1) = (u, v) / μ.
    a, b = left * step, (left + 1) * step
    with np.errstate(divide="ignore", invalid="ignore"):
        p = (u * np.sin(b) - v * np.cos(b)) / (eq.mu * np.sin(step))
        q = (v * np.cos(a) - u * np.sin(a)) / (eq.mu * np.sin(step))
    p, q = (np.nan_to_num(w, nan=0.0, posinf=0.0, neginf=0.0) for w in (p, q))
    x = np.zeros((len(scaled), eq.sides))
    rows = np.arange(len(scaled))
    x[rows, left.astype(int) % eq.sides] += p
    x[rows, (left.astype(int) + 1) % eq.sides] += q
    # What is left of the push is spread evenly: it adds no friction.
    x += ((normal - p - q) / eq.sides)[:, None]
    return _judge(eq, solver, x.ravel(), None)
