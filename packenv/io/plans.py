"""Plans as JSON files (schema version 1, described in docs/plan-format.md)."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from packenv.errors import ContainerError, InputError, PlanError, is_number
from packenv.geometry.transforms import quaternion_to_rotation, rotation_to_quaternion
from packenv.io.files import write_whole
from packenv.json_text import read_json
from packenv.limits import NO_LIMITS, ItemLimits
from packenv.shipped import BUILTIN, MEMORY
from packenv.types import Container, Leftover, MeshRecord, OrderLine, Placement, Plan, RobotPath, normal_name
from packenv.version import __version__

SCHEMA_VERSION = 1
_HUGE = 1e12
"""No number in a plan is larger; NaN is not either."""


_PATH = "manipulation"
"""Where a step's details keep the robot's path."""

_UNITS = {"length": "m", "mass": "kg", "volume": "m3", "angle": "rad"}


def write_plan(path: Path, plan: Plan) -> None:
    """Write a plan. The catalogue's folder is kept relative to the plan file.

    Raises:
        InputError: the file cannot be written.
    """
    document = plan_to_json(plan)
    if plan.catalogue not in (BUILTIN, MEMORY):
        document["catalogue"] = _relative(Path(plan.catalogue), path.parent)
    write_whole(path, (json.dumps(document, indent=1, allow_nan=False) + "\n").encode())


def plan_to_json(plan: Plan) -> dict[str, Any]:
    """The plan as a JSON-able mapping."""
    return {
        "schema_version": SCHEMA_VERSION,
        "generator": f"robotpack {__version__}",
        "units": dict(_UNITS),
        "catalogue": plan.catalogue,
        "unit": plan.unit,
        "density": plan.density,
        "container": {
            "name": plan.container.name,
            "size": list(plan.container.size),
            "max_kg": plan.container.max_kg,
        },
        "made_by": plan.made_by,
        "lying": plan.lying,
        "settings": plan.settings,
        "order": [
            {"item": line.item, "qty": line.qty, **_limits_to_json(line.limits)} for line in plan.order
        ],
        "meshes": {name: _mesh_to_json(mesh) for name, mesh in plan.meshes.items()},
        "steps": [_step_to_json(k, placement) for k, placement in enumerate(plan.placements, start=1)],
        "leftovers": [
            {
                "item": left.item,
                "instance": left.instance,
                "reason": left.reason,
                "detail": left.detail,
                "rejections": left.rejections,
            }
            for left in plan.leftovers
        ],
        "metrics": plan.metrics,
    }


def _step_to_json(step: int, placement: Placement) -> dict[str, Any]:
    return {
        "step": step,
        "item": placement.item,
        "instance": placement.instance,
        "position": placement.position.tolist(),
        "quat_xyzw": rotation_to_quaternion(placement.rotation).tolist(),
        "corner": placement.corner.tolist(),
        "extents": placement.extents.tolist(),
        "stable_pose": placement.pose_index,
        "yaw": placement.yaw,
        "score": placement.score,
        "candidates": placement.candidates,
        "route": placement.route,
        "checked": placement.checked,
        "rejections": placement.rejections,
        "details": {**placement.details, **_path_to_json(placement.path)},
    }


def _mesh_to_json(mesh: MeshRecord) -> dict[str, Any]:
    document = {f.name: getattr(mesh, f.name) for f in fields(mesh)}
    del document["limits"]
    for optional in ("envelope_sha256", "friction"):
        if document[optional] is None:
            del document[optional]
    return {**document, **_limits_to_json(mesh.limits)}


def _limits_to_json(limits: ItemLimits) -> dict[str, Any]:
    return {} if limits == NO_LIMITS else {"limits": limits.to_mapping()}


def _path_to_json(path: RobotPath | None) -> dict[str, Any]:
    if path is None:
        return {}
    values = {
        "grasp": path.grasp.tolist(),
        "grasp_kind": path.grasp_kind,
        "grasps_tried": path.grasps_tried,
        "cup_heights": path.cup_heights.tolist(),
        "joints": path.joints.tolist(),
    }
    return {_PATH: values}


def _relative(folder: Path, start: Path) -> str:
    """``folder`` as seen from ``start``, or absolute where the two share no root (Windows drives)."""
    try:
        return Path(os.path.relpath(folder.resolve(), start.resolve())).as_posix()
    except ValueError:
        return folder.resolve().as_posix()


def read_plan(path: Path) -> Plan:
    """Read a plan. A relative catalogue folder is resolved against the plan file's folder.

    Raises:
        PlanError: the file is missing, not JSON, of another schema version, or a value is wrong.
    """
    document = read_json(path, "a plan that pack wrote", PlanError)
    if not isinstance(document, dict) or "schema_version" not in document:
        raise PlanError(f"{path}: has no schema_version, give a plan that pack wrote")
    version = document["schema_version"]
    if type(version) is not int or version != SCHEMA_VERSION:
        raise PlanError(f"{path}: schema_version is {version!r:.80}, this version reads {SCHEMA_VERSION}")
    plan = Reader(path).plan(document)
    if plan.catalogue in (BUILTIN, MEMORY):
        return plan
    folder = (path.resolve().parent / plan.catalogue).resolve().as_posix()
    return replace(plan, catalogue=folder)


def _is_finite(value: object) -> bool:
    """Whether a JSON value is a number of a size that a pose, a score or a figure can have."""
    return is_number(value) and abs(value) <= _HUGE


class Reader:
    """Turns a JSON document into a plan; every complaint names the file and the place in it."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def fail(self, where: str, value: object, right: str) -> PlanError:
        """The error of a wrong value."""
        return PlanError(f"{self.path}: {where} is {value!r:.80}, should be {right}")

    def get(self, table: object, key: str, where: str) -> Any:
        """A value of a table."""
        if not isinstance(table, Mapping) or key not in table:
            raise PlanError(f"{self.path}: {where} has no {key!r}")
        return table[key]

    def text(self, table: object, key: str, where: str) -> str:
        """A text of a table."""
        value = self.get(table, key, where)
        if not isinstance(value, str):
            raise self.fail(f"{where}.{key}", value, "text")
        return value

    def name(self, row: object, where: str) -> str:
        """An item's name, as catalogues write it."""
        return normal_name(self.text(row, "item", where))

    def number(self, table: object, key: str, where: str) -> float:
        """A finite number."""
        value = self.get(table, key, where)
        if not _is_finite(value):
            raise self.fail(f"{where}.{key}", value, "a finite number")
        return float(value)

    def positive(self, table: object, key: str, where: str) -> float:
        """A number above 0."""
        value = self.number(table, key, where)
        if not value > 0.0:
            raise self.fail(f"{where}.{key}", value, "a number above 0")
        return value

    def count(self, table: object, key: str, where: str, least: int) -> int:
        """A whole number."""
        value = self.get(table, key, where)
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise self.fail(f"{where}.{key}", value, f"a whole number of at least {least}")
        return value

    def vector(self, table: object, key: str, where: str, size: int) -> np.ndarray:
        """Some finite numbers."""
        value = self.get(table, key, where)
        plain = isinstance(value, list) and len(value) == size
        if not plain or not all(map(_is_finite, value)):
            raise self.fail(f"{where}.{key}", value, f"{size} finite numbers")
        return np.array(value, dtype=np.float64)

    def rows(self, table: object, key: str) -> list[Any]:
        """A list of the document."""
        value = self.get(table, key, "the plan")
        if not isinstance(value, list):
            raise self.fail(key, value, "a list")
        return value

    def mapping(self, table: object, key: str, where: str = "the plan") -> dict[str, Any]:
        """A table within a table."""
        value = self.get(table, key, where)
        if not isinstance(value, dict):
            raise self.fail(key if where == "the plan" else f"{where}.{key}", value, "a mapping")
        return value

    def counts(self, table: object, key: str, where: str) -> dict[str, int]:
        """Whole numbers by name."""
        found = self.mapping(table, key, where)
        return {name: self.count(found, name, f"{where}.{key}", 0) for name in found}

    def rotation(self, table: object, where: str) -> np.ndarray:
        """(3, 3) of a unit quaternion."""
        quaternion = self.vector(table, "quat_xyzw", where, 4)
        if abs(float(np.linalg.norm(quaternion)) - 1.0) > 1e-6:
            raise self.fail(f"{where}.quat_xyzw", quaternion.tolist(), "a unit quaternion")
        return quaternion_to_rotation(quaternion)

    def placement(self, row: object, index: int) -> Placement:
        """A step of a plan."""
        where = f"steps[{index}]"
        if self.count(row, "step", where, 1) != index + 1:
            raise self.fail(f"{where}.step", self.get(row, "step", where), str(index + 1))
        details = self.mapping(row, "details", where)
        return Placement(
            item=self.name(row, where),
            instance=self.count(row, "instance", where, 1),
            rotation=self.rotation(row, where),
            position=self.vector(row, "position", where, 3),
            corner=self.vector(row, "corner", where, 3),
            extents=self.vector(row, "extents", where, 3),
            pose_index=self.count(row, "stable_pose", where, 0),
            yaw=self.number(row, "yaw", where),
            score=self.number(row, "score", where),
            candidates=self.count(row, "candidates", where, 0),
            route=self.text(row, "route", where),
            checked=self.count(row, "checked", where, 0),
            rejections=self.counts(row, "rejections", where),
            details={name: value for name, value in details.items() if name != _PATH},
            path=self.path_of_robot(details, f"{where}.details") if _PATH in details else None,
        )

    def path_of_robot(self, details: object, where: str) -> RobotPath:
        """The robot's way of a step."""
        stated, place = self.mapping(details, _PATH, where), f"{where}.{_PATH}"
        rows = self.get(stated, "joints", place)
        if not isinstance(rows, list) or len(rows) < 3:
            raise self.fail(f"{place}.joints", rows, "a path of three or more waypoints")
        joints = [
            self.vector({"joints": row}, "joints", f"{place}.joints[{k}]", 6) for k, row in enumerate(rows)
        ]
        return RobotPath(
            grasp=self.vector(stated, "grasp", place, 3),
            grasp_kind=self.text(stated, "grasp_kind", place),
            grasps_tried=self.count(stated, "grasps_tried", place, 0),
            cup_heights=self.vector(stated, "cup_heights", place, len(joints)),
            joints=np.array(joints),
        )

    def mesh(self, row: object, where: str) -> MeshRecord:
        """What a plan keeps of a mesh."""
        given = row if isinstance(row, Mapping) else {}
        return MeshRecord(
            self.text(row, "file", where),
            self.text(row, "sha256", where),
            self.positive(row, "volume", where),
            self.positive(row, "mass", where),
            bool(self.get(row, "mass_estimated", where)),
            self.limits(row, where),
            self.text(row, "envelope_sha256", where) if "envelope_sha256" in given else None,
            self.positive(row, "friction", where) if "friction" in given else None,
        )

    def limits(self, row: object, where: str) -> ItemLimits:
        """What may not be done with an item."""
        given = row.get("limits", {}) if isinstance(row, Mapping) else {}
        try:
            return ItemLimits.from_mapping(given)
        except InputError as problem:
            raise PlanError(f"{self.path}: {where}.limits: {problem}") from None

    def container(self, document: dict[str, Any]) -> Container:
        """The box."""
        box = self.mapping(document, "container")
        size = self.vector(box, "size", "container", 3)
        name = box.get("name")
        try:
            length, width, height = size.tolist()
            return Container(
                length, width, height, name if isinstance(name, str) else None, box.get("max_kg")
            )
        except ContainerError as problem:
            raise PlanError(f"{self.path}: {problem}") from None

    def plan(self, document: dict[str, Any]) -> Plan:
        """A whole plan."""
        container = self.container(document)
        unit = document.get("unit")
        made_by = document.get("made_by", "planner")
        plan = Plan(
            container=container,
            placements=tuple(self.placement(row, k) for k, row in enumerate(self.rows(document, "steps"))),
            leftovers=tuple(
                Leftover(
                    self.name(row, f"leftovers[{k}]"),
                    self.count(row, "instance", f"leftovers[{k}]", 1),
                    self.text(row, "reason", f"leftovers[{k}]"),
                    self.text(row, "detail", f"leftovers[{k}]"),
                    self.counts(row, "rejections", f"leftovers[{k}]"),
                )
                for k, row in enumerate(self.rows(document, "leftovers"))
            ),
            settings=dict(self.mapping(document, "settings")),
            made_by=made_by if isinstance(made_by, str) else "planner",
            lying=self.count(document, "lying", "the plan", 0) if "lying" in document else 0,
            metrics=self.mapping(document, "metrics"),
            catalogue=self.text(document, "catalogue", "the plan"),
            unit=unit if isinstance(unit, str) else None,
            density=None if document.get("density") is None else self.number(document, "density", "the plan"),
            order=tuple(
                OrderLine(
                    self.name(row, f"order[{k}]"),
                    self.count(row, "qty", f"order[{k}]", 1),
                    self.limits(row, f"order[{k}]"),
                )
                for k, row in enumerate(self.rows(document, "order"))
            ),
            meshes={
                normal_name(key): self.mesh(row, f"meshes.{key}")
                for key, row in self.mapping(document, "meshes").items()
            },
        )
        if document.get("units") != _UNITS:
            raise self.fail("units", document.get("units"), str(_UNITS))
        if plan.lying > len(plan.placements):
            raise self.fail("lying", plan.lying, f"at most {len(plan.placements)}, the number of steps")
        if not plan.order:
            raise self.fail("order", [], "the order's lines, at least one")
        self.check_pieces(plan)
        return plan

    def check_pieces(self, plan: Plan) -> None:
        """Every placed or left-over piece is one of the order's, and none is there twice."""
        ordered: Counter[str] = Counter()
        for line in plan.order:
            ordered[line.item] += line.qty
        seen: set[tuple[str, int]] = set()
        groups: tuple[tuple[str, Sequence[Placement | Leftover]], ...] = (
            ("steps", plan.placements),
            ("leftovers", plan.leftovers),
        )
        for where, pieces in groups:
            for k, piece in enumerate(pieces):
                if piece.item not in plan.meshes:
                    raise self.fail(f"{where}[{k}].item", piece.item, "a name under meshes")
                if piece.instance > ordered[piece.item]:
                    right = f"at most {ordered[piece.item]}, the ordered pieces of {piece.item}"
                    raise self.fail(f"{where}[{k}].instance", piece.instance, right)
                if (piece.item, piece.instance) in seen:
                    raise self.fail(f"{where}[{k}].instance", piece.instance, "no piece twice")
                seen.add((piece.item, piece.instance))
