"""RobotPack: plan, check, execute and learn the packing of real, non-convex items with a robot arm.

Importing this package registers the Gymnasium environments ``RobotPack-v0`` and, by name, those of
:mod:`packenv.env.presets`. The public names below are loaded when they are first asked for::

    import packenv as rp

    plan = rp.plan(rp.Order.of("mug", "bowl"), rp.Container(0.32, 0.32, 0.30), heuristic="hm")
"""

import importlib as _importlib
from typing import TYPE_CHECKING as _TYPE_CHECKING, Any as _Any

from gymnasium.envs.registration import register as _register

from packenv.env.presets import PRESETS as _PRESETS, env_id as _env_id

if _TYPE_CHECKING:
    from packenv.api import (
        load_catalogue as load_catalogue,
        load_order as load_order,
        load_partly_filled as load_partly_filled,
        load_plan as load_plan,
        plan as plan,
        plan_boxes as plan_boxes,
        plan_rehearsed as plan_rehearsed,
        plan_rest as plan_rest,
        rehearse as rehearse,
        save_plan as save_plan,
    )
    from packenv.env.config import PackConfig as PackConfig
    from packenv.env.orders import GeneratedOrder as GeneratedOrder, OrderGenerator as OrderGenerator
    from packenv.env.pack_env import PackEnv as PackEnv
    from packenv.env.reward import Outcome as Outcome, RewardFn as RewardFn
    from packenv.errors import InputError as InputError, RobotPackError as RobotPackError
    from packenv.execution.execute import ExecutedPlan as ExecutedPlan, execute as execute
    from packenv.execution.trajectories import trajectories as trajectories
    from packenv.io.lying import PartlyFilled as PartlyFilled
    from packenv.io.trajectories import Trajectories as Trajectories
    from packenv.items.catalogue import Catalogue as Catalogue
    from packenv.items.shelf import ItemShelf as ItemShelf
    from packenv.limits import ItemLimits as ItemLimits
    from packenv.planning.constraints import Constraint as Constraint, Trial as Trial, Verdict as Verdict
    from packenv.planning.options import PlanOptions as PlanOptions
    from packenv.planning.search.candidates import Candidates as Candidates
    from packenv.planning.search.heuristics import Heuristic as Heuristic
    from packenv.robot.cell import Cell as Cell, CellSetup as CellSetup
    from packenv.robot.files import load_cell as load_cell
    from packenv.robot.protocol import Robot as Robot
    from packenv.robot.timing import MotionLimits as MotionLimits
    from packenv.types import (
        Container as Container,
        Item as Item,
        Leftover as Leftover,
        Order as Order,
        OrderLine as OrderLine,
        Placement as Placement,
        Plan as Plan,
        Pose as Pose,
        RobotPath as RobotPath,
    )
    from packenv.verification.report import Verification as Verification, verify as verify
    from packenv.view.show import show as show
    from packenv.watcher import Watcher as Watcher

from packenv.version import __version__ as __version__

_PUBLIC = {
    "Candidates": "packenv.planning.search.candidates",
    "Catalogue": "packenv.items.catalogue",
    "Cell": "packenv.robot.cell",
    "CellSetup": "packenv.robot.cell",
    "Constraint": "packenv.planning.constraints",
    "Container": "packenv.types",
    "ExecutedPlan": "packenv.execution.execute",
    "GeneratedOrder": "packenv.env.orders",
    "Heuristic": "packenv.planning.search.heuristics",
    "InputError": "packenv.errors",
    "Item": "packenv.types",
    "ItemLimits": "packenv.limits",
    "ItemShelf": "packenv.items.shelf",
    "Leftover": "packenv.types",
    "MotionLimits": "packenv.robot.timing",
    "Order": "packenv.types",
    "OrderGenerator": "packenv.env.orders",
    "OrderLine": "packenv.types",
    "Outcome": "packenv.env.reward",
    "PackConfig": "packenv.env.config",
    "PackEnv": "packenv.env.pack_env",
    "PartlyFilled": "packenv.io.lying",
    "Placement": "packenv.types",
    "Plan": "packenv.types",
    "PlanOptions": "packenv.planning.options",
    "Pose": "packenv.types",
    "RewardFn": "packenv.env.reward",
    "Robot": "packenv.robot.protocol",
    "RobotPackError": "packenv.errors",
    "RobotPath": "packenv.types",
    "Trajectories": "packenv.io.trajectories",
    "Trial": "packenv.planning.constraints",
    "Verdict": "packenv.planning.constraints",
    "Verification": "packenv.verification.report",
    "Watcher": "packenv.watcher",
    "execute": "packenv.execution.execute",
    "load_catalogue": "packenv.api",
    "load_cell": "packenv.robot.files",
    "load_order": "packenv.api",
    "load_partly_filled": "packenv.api",
    "load_plan": "packenv.api",
    "plan": "packenv.api",
    "plan_boxes": "packenv.api",
    "plan_rehearsed": "packenv.api",
    "plan_rest": "packenv.api",
    "rehearse": "packenv.api",
    "save_plan": "packenv.api",
    "show": "packenv.view.show",
    "trajectories": "packenv.execution.trajectories",
    "verify": "packenv.verification.report",
}
"""Public names, and the modules that they are in."""

__all__ = [*sorted(_PUBLIC), "__version__"]

_register("RobotPack-v0", entry_point="packenv.env.pack_env:PackEnv")
for _name, _preset in _PRESETS.items():
    _register(_env_id(_name), entry_point="packenv.env.pack_env:PackEnv", kwargs=_preset.to_kwargs())


def __getattr__(name: str) -> _Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'packenv' has no attribute {name!r}")
    found = globals()[name] = getattr(_importlib.import_module(_PUBLIC[name]), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_PUBLIC})
