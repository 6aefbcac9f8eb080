"""Build the catalogue of household items: meshes, convex parts and objects.csv.

Run ``python assets/build_items.py`` to write into ``assets/catalogue``, ``--out DIR`` for another folder,
``--check`` to rebuild beside and compare every file's sha256 (exit code 1 where one differs).
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import tempfile
from pathlib import Path

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parent))

from builder.sections import recipes
from builder.spec import Recipe
from builder.union import build
from builder.writers import area_of, csv_bytes, obj_bytes, ply_bytes, row, volume_of, write

CATALOGUE = Path(__file__).resolve().parent / "catalogue"
LICENCE = "CC0-1.0"


def build_item(recipe: Recipe) -> tuple[dict[str, str], dict[str, bytes]]:
    """Row of the table and the files (name to bytes) of one item."""
    try:
        geometry = build(recipe.parts())
    except ValueError as error:
        raise ValueError(f"{recipe.name}: {error}") from error
    mesh_file, parts_file = f"{recipe.name}.ply", f"{recipe.name}.parts.obj"
    mass = recipe.mass.of(volume_of(geometry.mesh), area_of(geometry.mesh))
    text = row(
        geometry,
        name=recipe.name,
        file=mesh_file,
        parts_file=parts_file,
        category=recipe.category,
        mass_kg=f"{mass:.6g}",
        source=recipe.source,
        licence=LICENCE,
    )
    files = {mesh_file: ply_bytes(geometry.mesh), parts_file: obj_bytes(geometry.parts, recipe.name)}
    return text, files


def build_all(folder: Path) -> None:
    """Write the whole catalogue into ``folder``, which is made where it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    table = []
    for recipe in recipes().values():
        text, files = build_item(recipe)
        table.append(text)
        for name, data in files.items():
            write(folder / name, data)
    write(folder / "objects.csv", csv_bytes(table))


def digests(folder: Path) -> dict[str, str]:
    """The sha256 of every file of a catalogue folder."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.iterdir())}


def differences(folder: Path) -> list[str]:
    """Names of files that differ from, are missing in or are not made by a fresh build."""
    with tempfile.TemporaryDirectory() as fresh:
        build_all(Path(fresh))
        wanted = digests(Path(fresh))
    found = digests(folder) if folder.is_dir() else {}
    return sorted(name for name in wanted.keys() | found.keys() if wanted.get(name) != found.get(name))


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; 0 done, 1 the check found differences."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=CATALOGUE, help="folder of the catalogue")
    parser.add_argument("--check", action="store_true", help="compare with a fresh build, write nothing")
    options = parser.parse_args(arguments)
    if options.check:
        changed = differences(options.out)
        for name in changed:
            print(f"{options.out / name}: differs from a fresh build")
        return 1 if changed else 0
    build_all(options.out)
    print(f"{options.out}: {len(recipes())} items")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
