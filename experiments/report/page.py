"""A document as one HTML file: styles, plots and pictures are inside, and it loads and runs nothing."""

from __future__ import annotations

import base64
import re
from pathlib import Path

from .document import Document, Plot, Shot

_TEMPLATE = Path(__file__).with_name("page.html.jinja")


def page_text(document: Document) -> str:
    """The document as HTML; what it says is escaped."""
    import jinja2
    from markupsafe import Markup

    def svg_of(plot: Plot) -> Markup:
        """The plot as a part of a page, where two plots may not share names of their parts."""
        inside = re.sub(r'<g id="[^"]*"', "<g", plot.svg[plot.svg.index("<svg") :])
        inside = re.sub(r'( id="| xlink:href="#|url\(#)', rf"\g<1>{plot.name}-", inside)
        return Markup(inside.replace("<svg", '<svg role="img"', 1))

    def address_of(shot: Shot) -> str:
        return "data:image/png;base64," + base64.b64encode(shot.png).decode("ascii")

    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    environment.filters.update(svg=svg_of, address=address_of, kind=lambda block: type(block).__name__)
    template = environment.from_string(_TEMPLATE.read_text(encoding="utf-8"))
    return template.render(document=document) + "\n"
