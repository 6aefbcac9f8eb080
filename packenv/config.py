"""Settings that several packages share: the discretization of the search, with the paper's values, and gravity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from packenv.errors import InputError

CLEARANCE = 2e-5
"""How far surfaces, an item's and a wall's too, may be in each other and still count as touching, m.

An item as large as the container fits, and so does a stack of exact layers, whose heights are rounded up.
"""

EngineName: TypeAlias = Literal["auto", "bullet", "mujoco"]
"""A physics engine; ``auto``: PyBullet where it is installed, else MuJoCo."""

UNIT_NAMES = ("m", "cm", "mm", "in")
"""Units that meshes may have."""

GRAVITY = 9.81
"""Acceleration of gravity, m/s²."""

HEIGHT_QUANTUM = 2.0**-20
"""Heights in heightmaps are multiples of this many metres (0.95 µm), rounded outward.

Such numbers up to 16 m are exact in float32, and so are their differences and maxima; their sums are
exact in float64. The fast search therefore equals the reference bit for bit, whatever the order of
summation.
"""


@dataclass(frozen=True)
class GridConfig:
    """The discretization of the search (paper Sec. IV-B and V).

    Attributes:
        cell_size: side of a heightmap cell, m.
        grid_step: distance between tried translations in x and y, m; a whole number of cells.
        n_poses: planar-stable poses tried, by falling quasi-static probability.
        n_yaws: yaws tried for each pose, evenly over [0, π).
    """

    cell_size: float = 0.002
    grid_step: float = 0.01
    n_poses: int = 4
    n_yaws: int = 4

    def __post_init__(self) -> None:
        """Check that the grid can be built.

        Raises:
            InputError: a value is not positive, or ``grid_step`` is not a whole number of cells.
        """
        if not 2e-4 <= self.cell_size <= 0.05:
            raise InputError(f"cell_size is {self.cell_size:g} m, give a value between 0.0002 and 0.05")
        ratio = self.grid_step / self.cell_size
        if not (
            self.grid_step > 0 and ratio < 1e4 and abs(ratio - round(ratio)) < 1e-6 and round(ratio) >= 1
        ):
            raise InputError(
                f"grid_step is {self.grid_step:g} m, give a multiple of cell_size ({self.cell_size:g} m): "
                "only then are placements collision-free by construction"
            )
        if self.n_poses < 1 or self.n_yaws < 1:
            raise InputError(f"n_poses is {self.n_poses} and n_yaws {self.n_yaws}, both must be at least 1")

    @property
    def step_cells(self) -> int:
        """Cells between two tried translations."""
        return round(self.grid_step / self.cell_size)
