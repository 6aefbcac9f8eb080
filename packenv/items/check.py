"""A table of every mesh in a catalogue and what is wrong with it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from packenv.errors import InputError, UnitError
from packenv.geometry.mass import hull_volume
from packenv.items.catalogue import Catalogue, open_catalogue
from packenv.items.sizes import suspicious_sizes


@dataclass(frozen=True)
class ItemReport:
    """What a check of one item found. Figures are None where the mesh cannot be used.

    Attributes:
        name: of the item.
        file: its mesh file.
        status: ``ok``, ``repaired`` or ``error``.
        vertices: number of them.
        faces: number of them.
        extents: (x, y, z) of the bounding box, m.
        volume: m³.
        mass: kg.
        mass_estimated: True where no mass was given.
        convexity: volume over the hull's volume.
        text: the problem, the repairs and the notes; empty where there is nothing to say.
        limits: what may not be done with it, a phrase each.
    """

    name: str
    file: str
    status: str
    vertices: int | None = None
    faces: int | None = None
    extents: tuple[float, float, float] | None = None
    volume: float | None = None
    mass: float | None = None
    mass_estimated: bool = False
    convexity: float | None = None
    text: str = ""
    limits: tuple[str, ...] = ()


def check_items(
    folder: Path | str | None,
    unit: str | None = None,
    progress: Callable[[Sequence[str]], Iterable[str]] | None = None,
) -> list[ItemReport]:
    """Load every item of a catalogue and say what is wrong with it.

    Args:
        folder: as for :func:`packenv.items.catalogue.open_catalogue`.
        unit: as there.
        progress: wraps the names to show how far the check is, as ``tqdm`` does.

    Returns:
        One report an item, in the catalogue's sequence; a mesh that cannot be used is a report too.

    Raises:
        CatalogueError: the folder or its table is wrong.
    """
    catalogue = open_catalogue(folder, unit=unit)
    names: Iterable[str] = progress(catalogue.names) if progress else catalogue.names
    sizes: dict[str, float] = {}
    reports = [_report(catalogue, name, sizes) for name in names]
    # Against all known sizes, and without the refused ones: either may be those whose unit is right.
    usable = {r.name: sizes[r.name] for r in reports if r.extents}
    said = {**suspicious_sizes(sizes), **suspicious_sizes(usable)}
    return [
        replace(r, text="; ".join(filter(None, (r.text, said[r.name]))))
        if r.extents and r.name in said
        else r
        for r in reports
    ]


def _report(catalogue: Catalogue, name: str, sizes: dict[str, float]) -> ItemReport:
    """What a check of an item found; its longest side, where that is known, goes into ``sizes``."""
    file = catalogue.entries[name].file
    try:
        item = catalogue.item(name)
    except InputError as problem:
        if isinstance(problem, UnitError) and problem.longest is not None:
            sizes[name] = problem.longest
        text = str(problem).removeprefix(f"{catalogue.folder / file}: ")
        return ItemReport(name, file, "error", text=text)
    x, y, z = item.extents.tolist()
    sizes[name] = max(x, y, z)
    return ItemReport(
        name,
        file,
        "repaired" if item.repairs else "ok",
        len(item.vertices),
        len(item.faces),
        (x, y, z),
        item.volume,
        item.mass,
        item.mass_estimated,
        item.volume / hull_volume(item.vertices),
        "; ".join((*item.repairs, *item.notes)),
        item.limits.words,
    )


def format_table(reports: Sequence[ItemReport]) -> str:
    """The reports as aligned text with a line of totals.

    Args:
        reports: from :func:`check_items`.

    Returns:
        Lines without a final line break; ``~`` marks an estimated mass.
    """
    header = (
        "item",
        "status",
        "vertices",
        "faces",
        "size mm",
        "volume cm³",
        "mass kg",
        "convexity",
        "remarks",
    )
    rows = [header, *(_cells(report) for report in reports)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(header) - 1)]
    left = (0, 1)
    lines = [
        "  ".join(
            [
                c.ljust(w) if k in left else c.rjust(w)
                for k, (c, w) in enumerate(zip(row, widths, strict=False))
            ]
            + [row[-1]]
        ).rstrip()
        for row in rows
    ]
    counts = {status: sum(r.status == status for r in reports) for status in ("ok", "repaired", "error")}
    lines.append(
        f"{len(reports)} items: {counts['ok']} ok, {counts['repaired']} repaired, {counts['error']} unusable"
    )
    if any(report.mass_estimated for report in reports):
        lines.append("~ mass estimated from volume and hull volume")
    return "\n".join(lines)


def _cells(report: ItemReport) -> tuple[str, ...]:
    if report.extents is None or report.volume is None or report.mass is None or report.convexity is None:
        return (report.name, report.status, "", "", "", "", "", "", f"{report.file}: {report.text}")
    size = " x ".join(f"{side * 1000:.0f}" for side in report.extents)
    mass = f"{'~' if report.mass_estimated else ''}{report.mass:.3g}"
    return (
        report.name,
        report.status,
        str(report.vertices),
        str(report.faces),
        size,
        f"{report.volume * 1e6:.1f}",
        mass,
        f"{report.convexity:.2f}",
        "; ".join(filter(None, (", ".join(report.limits), report.text))),
    )
