"""Bokeh figures inside a page: one document, the same bytes every time, nothing fetched.

Bokeh numbers its models by a counter that runs on through the process. Here they are numbered anew, by
their order in the document, so that the same figures give the same bytes.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from bokeh.document import Document
from bokeh.models import LayoutDOM
from bokeh.resources import Resources

_START = """\
(function () {
  const data = JSON.parse(document.getElementById("figures").textContent);
  Bokeh.embed.embed_items(data.documents, data.places);
})();"""


@dataclass(frozen=True, slots=True)
class Script:
    """JavaScript for the page, and the policy that lets the browser run it and nothing else."""

    code: str

    @property
    def tag(self) -> str:
        """The script's element."""
        return f"<script>{self.code}</script>"

    @property
    def source(self) -> str:
        """The script's hash, as a content security policy wants it."""
        digest = hashlib.sha256(self.code.encode()).digest()
        return f"'sha256-{base64.b64encode(digest).decode()}'"


def scripts() -> tuple[Script, Script]:
    """Bokeh itself, without its widgets, tables and formulae, and the start of the figures."""
    bokeh = Resources(mode="inline", components=["bokeh"], minified=True, log_level="error")
    return Script("\n".join(bokeh.js_raw)), Script(_START)


def figures(models: Sequence[LayoutDOM], places: Sequence[str]) -> str:
    """The data of all figures, as an element for the page that runs nothing.

    Parameters
    ----------
    models : sequence of bokeh.models.LayoutDOM
        The figures; they may share ranges.
    places : sequence of str
        The id of the element into which each goes.
    """
    document = Document(title="")
    for model in models:
        document.add_root(model)
    numbers: dict[str, str] = {}
    content = _renumbered(document.to_json(deferred=False), numbers)
    roots = {numbers[model.id]: place for model, place in zip(models, places, strict=True)}
    data = {
        "documents": {"page": content},
        "places": [{"docid": "page", "roots": roots, "root_ids": list(roots)}],
    }
    text = json.dumps(data, allow_nan=False, ensure_ascii=True, separators=(",", ":"))
    # No "<" and so no "</script>" or "<!--" of a recording can end the element.
    harmless = text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
    return f'<script type="application/json" id="figures">{harmless}</script>'


def _renumbered(node: Any, numbers: dict[str, str]) -> Any:  # what JSON can hold
    if isinstance(node, dict):
        return {
            key: _number(value, numbers) if key == "id" else _renumbered(value, numbers)
            for key, value in node.items()
        }
    if isinstance(node, list | tuple):
        return [_renumbered(item, numbers) for item in node]
    return node


def _number(name: str, numbers: dict[str, str]) -> str:
    return numbers.setdefault(name, f"p{len(numbers)}")
