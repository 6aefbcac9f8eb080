"""The viewer page: what it holds is the plan, it loads nothing, and a browser draws it."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import re
import shutil
import subprocess
import zlib
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from packenv.errors import InputError, PlanError
from packenv.types import Container, Item, Leftover, Placement, Plan
from packenv.view import page as viewer
from packenv.view.page import LENGTH_UNIT, pack_integers, page_text, write_page
from packenv.view.scene import Scene, build_scene
from tests import shapes

EVIL = "</script><script>window.evil=1</script><img src=x onerror=alert(1)> {{BUNDLE}} & \"q\" 'a'"


def turn(yaw: float) -> np.ndarray:
    return np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])


def place(item: Item, corner: tuple[float, float, float], yaw: float = 0.0, instance: int = 1) -> Placement:
    rotated = item.vertices @ turn(yaw).T
    position = np.array(corner) - rotated.min(axis=0)
    return Placement(
        item.name, instance, turn(yaw), position, np.array(corner), np.ptp(rotated, axis=0), 0, yaw, 0.25, 7
    )


def make_scene(extra_name: str = "cup") -> Scene:
    crate, ball, cup = (
        shapes.box(0.1, 0.08, 0.06, "crate"),
        shapes.ball(0.04),
        shapes.cup(0.04, 0.08, name=extra_name),
    )
    placements = (
        place(crate, (0.0, 0.0, 0.0)),
        place(ball, (0.12, 0.1, 0.0)),
        place(crate, (0.0, 0.0, 0.06), 0.7, 2),
        place(cup, (0.2, 0.02, 0.0)),
    )
    plan = Plan(
        Container(0.32, 0.3, 0.25),
        placements,
        (Leftover(extra_name, 2, "no-legal-candidate", f"No room for {extra_name}."),),
        {"heuristic": "hm", "nested": {"yaws": [0, 45], "limit": np.float64("inf")}},
        {"utilization": 0.1},
    )
    generator = np.random.default_rng(4)
    maps = [generator.uniform(0, 0.25, (16, 15)).astype(np.float32) for _ in placements]
    return build_scene(plan, {item.name: item for item in (crate, ball, cup)}, maps, 0.02)


class Page(HTMLParser):
    """What a browser would see in the page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.scripts: list[tuple[dict[str, str | None], str]] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.title = ""
        self._inside = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._inside = tag
        self.tags.append((tag, dict(attrs)))
        if tag == "script":
            self.scripts.append((dict(attrs), ""))

    def handle_endtag(self, tag: str) -> None:
        self._inside = ""

    def handle_data(self, data: str) -> None:
        if self._inside == "script":
            attributes, text = self.scripts[-1]
            self.scripts[-1] = (attributes, text + data)
        if self._inside == "title":
            self.title += data

    def script(self, name: str) -> str:
        return next(text for attributes, text in self.scripts if attributes.get("id") == name)


def unpack(block: bytes, place: dict[str, int]) -> np.ndarray:
    """The coding of the page, undone independently of the page's script."""
    offset, count = place["offset"], place["count"]
    planes = np.frombuffer(block, np.uint8, 4 * count, offset).reshape(4, count).astype(np.int64)
    zigzag = planes[0] + 256 * planes[1] + 65536 * planes[2] + 16777216 * planes[3]
    return np.cumsum(np.where(zigzag % 2 == 0, zigzag // 2, -(zigzag + 1) // 2))


def decode(text: str) -> tuple[dict, bytes]:
    page = Page(text)
    return json.loads(page.script("scene-data")), zlib.decompress(
        base64.b64decode(page.script("scene-arrays"))
    )


def test_meshes_poses_and_heightmaps_come_back_within_5_micrometres() -> None:
    scene = make_scene()
    record, block = decode(page_text(scene))
    for step, shown in zip(scene.steps, record["steps"], strict=True):
        mesh = record["meshes"][shown["mesh"]]
        vertices = np.stack([unpack(block, axis) for axis in mesh["vertices"]], axis=1) * mesh["unit"]
        faces = unpack(block, mesh["faces"]).reshape(-1, 3)
        assert np.array_equal(faces, step.item.faces)
        assert np.abs(vertices - step.item.vertices).max() <= LENGTH_UNIT / 2 + 1e-12
        matrix = np.array(shown["matrix"]).reshape(3, 4)
        placed = vertices @ matrix[:, :3].T + matrix[:, 3]
        assert np.abs(placed - step.vertices).max() <= 5e-5
    maps = record["heightmap"]
    heights = unpack(block, maps["heights"]).reshape(-1, maps["nx"], maps["ny"]).cumsum(axis=0) * maps["unit"]
    assert np.abs(heights - np.stack(scene.heightmaps)).max() <= LENGTH_UNIT / 2 + 1e-9


def test_integer_coding_loses_nothing() -> None:
    generator = np.random.default_rng(0)
    for values in (generator.integers(-(2**30), 2**30, 999), np.array([0]), np.array([-1, 2**30, -(2**30)])):
        assert np.array_equal(unpack(pack_integers(values), {"offset": 0, "count": values.size}), values)


def test_steps_keep_the_packing_sequence_and_equal_items_share_one_mesh() -> None:
    record, _ = decode(page_text(make_scene()))
    assert [(s["item"], s["instance"]) for s in record["steps"]] == [
        ("crate", 1),
        ("ball", 1),
        ("crate", 2),
        ("cup", 1),
    ]
    assert len(record["meshes"]) == 3
    assert record["steps"][0]["mesh"] == record["steps"][2]["mesh"]
    assert len({s["colour"] for s in record["steps"]}) == 4
    assert ["Packed", "4 of 5"] in record["summary"]


def test_equal_scenes_give_equal_pages() -> None:
    assert page_text(make_scene()) == page_text(make_scene())


def test_names_never_become_markup() -> None:
    text = page_text(make_scene(EVIL))
    page = Page(text)
    # Data, arrays and the one script that runs; the name adds none.
    assert [attributes.get("type") for attributes, _ in page.scripts] == [
        "application/json",
        "text/plain",
        None,
    ]
    assert not any(tag == "img" for tag, _ in page.tags)
    record = json.loads(page.script("scene-data"))
    assert record["steps"][3]["item"] == EVIL
    assert EVIL in record["leftovers"][0]["detail"]


def test_a_title_is_text() -> None:
    scene = make_scene()
    titled = Scene(scene.container, scene.steps, title=EVIL)
    page = Page(page_text(titled))
    assert page.title == EVIL
    assert not any(tag == "img" for tag, _ in page.tags)


def test_the_page_can_load_nothing() -> None:
    text = page_text(make_scene())
    addresses = set(re.findall(r"https?://[^\s\"'<>)`]*", text))
    assert addresses <= {"http://www.w3.org/1999/xhtml"}
    script = Page(text).scripts[-1][1]
    assert len(script) > 100_000
    for call in (
        r"\bfetch\s*\(",
        r"\bimport\s*\(",
        r"\bimport\s*[\"'{*]",
        "XMLHttpRequest",
        "WebSocket",
        "sendBeacon",
        "importScripts",
    ):
        assert not re.search(call, script), call
    for tag, attributes in Page(text).tags:
        assert tag not in ("link", "img", "iframe", "object", "embed")
        assert not {"src", "srcset", "data"} & attributes.keys()
    policy = next(
        a["content"] for _, a in Page(text).tags if a.get("http-equiv") == "Content-Security-Policy"
    )
    assert policy is not None
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe" not in policy


def test_three_js_keeps_its_licence() -> None:
    text = page_text(make_scene())
    assert "three.js authors" in text
    assert "The above copyright notice and this permission notice shall be included" in text


def test_the_bundle_is_built_from_the_sources_beside_it() -> None:
    folder = Path(viewer.__file__).with_name("viewer_page")
    sources = hashlib.sha256()
    for source in sorted((folder / "src").iterdir()):
        sources.update(source.read_bytes())
    built = re.search(r"Sources: ([0-9a-f]{64})", (folder / "viewer.bundle.js").read_text(encoding="utf-8"))
    assert built is not None
    assert built.group(1) == sources.hexdigest(), "run 'npm ci && npm run build' in packenv/view/viewer_page"


def test_ten_fine_items_stay_under_three_megabytes() -> None:
    generator = np.random.default_rng(1)
    items = {}
    for k in range(10):
        ball = shapes.ball(0.05, f"ball{k}", subdivisions=5)  # 10,242 vertices
        rough = ball.vertices + generator.normal(0, 3e-4, ball.vertices.shape)
        items[ball.name] = Item(
            ball.name, rough, ball.faces, ball.volume, 0.1, False, ball.com, ball.inertia, f"{k}", "x.ply"
        )
    placements = tuple(place(item, (0.1, 0.1, 0.0)) for item in items.values())
    maps = [generator.uniform(0, 0.3, (160, 160)) * (generator.random((160, 160)) < 0.1) for _ in items]
    scene = build_scene(Plan(Container(0.32, 0.32, 0.3), placements, ()), items, np.cumsum(maps, axis=0))
    assert len(page_text(scene)) < 3_000_000


def test_an_item_that_the_catalogue_lacks_is_named() -> None:
    scene = make_scene()
    plan = Plan(scene.container, tuple(s.placement for s in scene.steps), ())
    with pytest.raises(PlanError, match="'ball'"):
        build_scene(plan, {"crate": scene.steps[0].item})


def test_heightmaps_must_be_one_for_each_placement() -> None:
    scene = make_scene()
    plan = Plan(scene.container, tuple(s.placement for s in scene.steps), ())
    items = {s.item.name: s.item for s in scene.steps}
    with pytest.raises(ValueError, match="heightmaps: 1 given for 4 placements"):
        build_scene(plan, items, [np.zeros((2, 2))])


def test_a_page_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="missing"):
        write_page(tmp_path / "missing" / "page.html", make_scene())
    write_page(tmp_path / "page.html", make_scene())
    assert [p.name for p in tmp_path.iterdir()] == ["page.html"]


# ---------------------------------------------------------------- in a browser


def browser() -> str:
    for name in ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome"):
        found = shutil.which(name)
        if found:
            return found
    pytest.skip("no Chromium or Chrome on the path: the page was not drawn")


def visit(page: Path, state: str, tmp_path: Path) -> tuple[dict[str, str | None], str, np.ndarray]:
    """Open a page; returns the attributes of <html>, the document after scripts ran, and the picture."""
    shot = tmp_path / "shot.png"
    options = ["--headless=new", "--no-sandbox", "--hide-scrollbars", "--window-size=1000,700"]
    options += ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    options += ["--virtual-time-budget=5000", "--dump-dom"]
    done = subprocess.run(
        [
            browser(),
            *options,
            f"--user-data-dir={tmp_path / 'profile'}",
            f"--screenshot={shot}",
            f"{page.as_uri()}#{state}",
        ],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "HOME": str(tmp_path)},
        check=True,
    )
    root = next(attributes for tag, attributes in Page(done.stdout).tags if tag == "html")
    with Image.open(shot) as image:
        return root, done.stdout, np.asarray(image.convert("RGB")).astype(int)


def near_colour(picture: np.ndarray, wanted: tuple[int, int, int]) -> int:
    """Number of pixels with about the hue of a colour, whatever the light on them."""
    unit = picture / np.maximum(np.linalg.norm(picture, axis=2, keepdims=True), 1)
    return int((unit @ (np.array(wanted) / np.linalg.norm(wanted)) > 0.997).sum())


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    page = tmp_path_factory.mktemp("page") / "plan.html"
    write_page(page, make_scene(EVIL))
    return page


def test_a_browser_draws_the_step_that_the_address_names(written: Path, tmp_path: Path) -> None:
    root, document, picture = visit(written, "step=2", tmp_path)
    assert root["data-state"] == "ready"
    assert "data-error" not in root
    stage = picture[110:600, 20:620]
    assert len(np.unique(stage.reshape(-1, 3), axis=0)) > 200
    # Steps 1 and 2 (blue crate, orange ball) are in the picture; step 3 (green) is not yet.
    assert near_colour(stage, (0x4E, 0x8F, 0xD0)) > 300
    assert near_colour(stage, (0xF2, 0xA5, 0x41)) > 300
    assert near_colour(stage, (0x57, 0xA7, 0x73)) < 30
    assert "Step 2 of 4" in document
    assert "<img" not in document


def test_a_browser_draws_the_heightmap_instead_of_the_items(written: Path, tmp_path: Path) -> None:
    root, document, picture = visit(written, "step=4&heightmap=1", tmp_path)
    assert root["data-state"] == "ready"
    stage = picture[110:600, 110:620]
    assert near_colour(stage, (0xF2, 0xA5, 0x41)) < 30
    assert near_colour(stage, (0x44, 0x01, 0x54)) > 100  # the scale's dark end: violet
    legend = re.search(r"<figure[^>]*id=\"legend\"[^>]*>", document)
    assert legend is not None
    assert "hidden" not in legend.group(0)
