"""What there is to see of a plan: the one record that the viewer page and the picture draw."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from packenv.errors import PlanError
from packenv.types import Container, Float32Array, FloatArray, Item, Leftover, Placement, Plan, Pose
from packenv.view.words import limit_words, loads_at_end, piece_names, robustness_figures, rule_words


@dataclass(frozen=True, eq=False)
class SceneStep:
    """One placed item.

    Attributes:
        placement: where it lies.
        item: the item, with its mesh.
        figures: what a reader may want to know of this step, label to value. A value is a string, a
            number, a bool, or again a mapping or a sequence of these; the page prints it as it stands,
            so units belong into the strings.
        measured: where the item lies after an execution: (3, 3) mesh frame to container frame and (3,) m;
            None where it was not placed, or nothing was executed.
        name: of the piece, as people read it.
        limits: what may not be done with it, and what rests on it in the end, a phrase each.
    """

    placement: Placement
    item: Item
    figures: Mapping[str, object] = field(default_factory=dict)
    measured: Pose | None = None
    name: str = ""
    limits: tuple[str, ...] = ()

    @property
    def vertices(self) -> FloatArray:
        """(n, 3) the mesh's vertices in the container frame, m: where it was measured, else as planned."""
        return (self.measured or self.placement.pose).apply(self.item.vertices)


@dataclass(frozen=True, eq=False)
class Scene:
    """A plan with everything that is needed to draw it.

    Attributes:
        container: the box.
        steps: placed items in packing sequence.
        heightmaps: for every step the container's heightmap after it, (nx, ny), m; empty where there
            are none to show.
        cell_size: side of one heightmap cell, m.
        leftovers: what did not fit, with reasons.
        title: heading of the page.
        metrics: figures of the plan.
        settings: the configuration that produced the plan.
        verdict: what came of an execution, label and text of each figure; empty where there was none. Then
            measured poses are shown, and the planned ones beside them.
        heuristic: what made the plan, in words.
    """

    container: Container
    steps: tuple[SceneStep, ...]
    heightmaps: tuple[Float32Array, ...] = ()
    cell_size: float = 0.002
    leftovers: tuple[Leftover, ...] = ()
    title: str = "Packing plan"
    metrics: Mapping[str, object] = field(default_factory=dict)
    settings: Mapping[str, object] = field(default_factory=dict)
    verdict: tuple[tuple[str, str], ...] = ()
    heuristic: str = ""

    @property
    def utilization(self) -> float:
        """Volume of the placed items over the volume of the container, 0 to 1."""
        return sum(step.item.volume for step in self.steps) / self.container.volume

    @property
    def height(self) -> float:
        """Highest point of the placed items above the floor, m; 0 for an empty container."""
        tops = (float(s.placement.corner[2] + s.placement.extents[2]) for s in self.steps)
        return max(tops, default=0.0)


def build_scene(
    plan: Plan,
    items: Mapping[str, Item],
    heightmaps: Sequence[ArrayLike] = (),
    cell_size: float = 0.002,
    *,
    title: str | None = None,
    extra_figures: Sequence[Mapping[str, object]] = (),
) -> Scene:
    """Bring a plan, its meshes and its heightmaps together.

    Args:
        plan: the plan to show.
        items: the catalogue's items by name; every placed item must be among them.
        heightmaps: after each placement the container's heightmap, (nx, ny), m, in packing sequence;
            empty to show none.
        cell_size: side of one heightmap cell, m.
        title: heading; by default it names the number of items and the container.
        extra_figures: for each placement further figures to show, as in :class:`SceneStep`; empty for none.

    Returns:
        The scene.

    Raises:
        PlanError: the plan places an item that ``items`` does not hold.
        ValueError: ``heightmaps`` or ``extra_figures`` is neither empty nor one for each placement.
    """
    count = len(plan.placements)
    for label, given in (("heightmaps", len(heightmaps)), ("extra_figures", len(extra_figures))):
        if given not in (0, count):
            raise ValueError(f"{label}: {given} given for {count} placements, give one for each or none")
    extras: Sequence[Mapping[str, object]] = extra_figures or [{}] * count
    steps = []
    names, loads = piece_names(plan.placements), loads_at_end(plan.placements)
    for number, (placement, name, extra) in enumerate(zip(plan.placements, names, extras, strict=True), 1):
        if placement.item not in items:
            raise PlanError(
                f"the plan places {placement.item!r}, which the catalogue does not hold: "
                "give the catalogue that the plan was made with"
            )
        item = items[placement.item]
        figures = {**_placement_figures(placement, item), **extra}
        limits = limit_words(item, loads.get(number))
        steps.append(SceneStep(placement, item, figures, name=name, limits=limits))
    maps = []
    for given_map in heightmaps:
        array = np.array(given_map, dtype=np.float32)
        array.setflags(write=False)
        maps.append(array)
    return Scene(
        container=plan.container,
        steps=tuple(steps),
        heightmaps=tuple(maps),
        cell_size=cell_size,
        leftovers=plan.leftovers,
        title=title or f"{count} item{'s' * (count != 1)} in container {plan.container.label}",
        metrics=dict(plan.metrics),
        settings={
            **{name: "none" if value in (None, []) else value for name, value in plan.settings.items()},
            "made_by": plan.made_by,
        },
        heuristic=rule_words(plan),
    )


def _millimetres(values: FloatArray) -> str:
    """Lengths in m as ``12.0 × 34.5 × 6.0 mm``."""
    # Adding 0 turns the -0.0 of a rounded corner at the wall into 0.0.
    return " × ".join(f"{round(float(v) * 1000, 1) + 0.0:.1f}" for v in values) + " mm"


def _placement_figures(placement: Placement, item: Item) -> dict[str, object]:
    """The figures that every placement has, formatted for people."""
    grams = item.mass * 1000
    mass = f"{grams:.0f} g" if grams < 1000 else f"{item.mass:.3f} kg"
    score = f"{placement.score:.6g}" if math.isfinite(placement.score) else str(placement.score)
    return {
        "Mass": mass + (" (estimated)" if item.mass_estimated else ""),
        "Volume": f"{item.volume * 1e6:.0f} cm³",
        "Size": _millimetres(placement.extents),
        "Corner": _millimetres(placement.corner).replace(" ×", ","),
        "Stable pose": placement.pose_index + 1,
        "Yaw": f"{math.degrees(placement.yaw):.0f}°",
        "Score": score,
        "Candidates": placement.candidates,
        "Route": placement.route,
        **_constraint_figures(placement),
    }


def _constraint_figures(placement: Placement) -> dict[str, object]:
    """What the constraints told of a placement; nothing under non-overlap alone."""
    if not placement.details and placement.path is None:
        return {}
    figures: dict[str, object] = {"Checked": placement.checked}
    if placement.rejections:
        figures["Rejected"] = dict(placement.rejections)
    clearance = placement.details.get("clearance_m")
    if isinstance(clearance, int | float):
        figures["Clearance"] = f"{clearance * 1e3:.0f} mm"
    for name, describe in (
        ("robustness", robustness_figures),
        ("stability", _stability_figures),
        ("physics", _physics_figures),
    ):
        details = placement.details.get(name)
        if isinstance(details, Mapping):
            try:
                figures.update(describe(details))
            except (KeyError, TypeError, ValueError, IndexError):
                figures[name.capitalize()] = "not as RobotPack writes it"
    if placement.path is not None:
        figures["Grasp"] = f"{placement.path.grasp_kind}, {_point(placement.path.grasp.tolist())}"
        figures["Joints"] = ", ".join(f"{math.degrees(q):.1f}°" for q in placement.path.joints[-1])
    return figures


def _stability_figures(details: Mapping[str, Any]) -> dict[str, object]:
    figures: dict[str, object] = {"Contacts": details["contacts"]}
    if "margin_deg" in details:
        figures["Tilt margin"] = f"{float(details['margin_deg']):.1f}°"
    figures["Forces on it"] = [
        f"{math.hypot(*force['force']):.2f} N at {_point(force['at'])}" for force in details["forces"]
    ]
    return figures


def _physics_figures(details: Mapping[str, Any]) -> dict[str, object]:
    rule = str(details.get("rule", "strict"))
    if rule == "no-drop":
        return {"In a drop": "not tried"}
    shift, sink = float(details["shift_m"]) * 1e3, float(details["sink_m"]) * 1e3
    figures: dict[str, object] = {
        "In a drop": f"shifts {shift:.1f} mm, sinks {sink:.1f} mm, turns {float(details['turned_deg']):.1f}°"
    }
    if rule != "strict":
        figures["Drop judged"] = rule
    return figures


def _point(at: Sequence[float]) -> str:
    """A point in m as ``12.0, 34.5, 6.0 mm``."""
    return _millimetres(np.array([float(v) for v in at])).replace(" ×", ",")
