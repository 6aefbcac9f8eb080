"""The paper's figures in a report."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from packenv.errors import InputError
from packenv.experiments.report.document import Gallery, Heading
from packenv.experiments.report.paper_figures import figures_section


def _written(folder: Path) -> Path:
    (folder / "figures").mkdir()
    (folder / "figures/bowls.png").write_bytes(b"picture")
    figure = {"name": "bowls", "title": "Bowls", "caption": "Three <bowls>.", "paper": "Fig. 3"}
    index = folder / "figures/figures.json"
    index.write_text(json.dumps({"figures": [{**figure, "files": ["bowls.png"]}]}))
    return index


def test_figures_that_were_made_are_a_section_of_their_own(tmp_path: Path) -> None:
    assert figures_section(tmp_path) is None
    _written(tmp_path)
    section = figures_section(tmp_path)
    assert section is not None
    heading, gallery = section.blocks
    assert isinstance(heading, Heading)
    assert isinstance(gallery, Gallery)
    assert "Bowls" in heading.text
    assert "Fig. 3" in heading.text
    (shot,) = gallery.shots
    assert (shot.png, shot.caption, gallery.large) == (b"picture", "Three <bowls>.", True)


def test_a_damaged_list_or_a_picture_that_is_gone_is_one_line(tmp_path: Path) -> None:
    index = _written(tmp_path)
    (tmp_path / "figures/bowls.png").unlink()
    with pytest.raises(InputError, match=r"bowls\.png: cannot be read"):
        figures_section(tmp_path)
    index.write_text('{"figures": [{"name": 1}]}')
    with pytest.raises(InputError, match="is no list of figures"):
        figures_section(tmp_path)
