"""The tree of pages beside each page, from their titles alone.

Sphinx copies the headings of all pages for each page, and then leaves them out: a fifth of a build.
"""

from __future__ import annotations

from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

Tables = dict[str, nodes.bullet_list]


def setup(app: Sphinx) -> dict[str, bool]:
    """Offer the theme a tree, before it asks for one (500)."""
    app.connect("html-page-context", _offer_tree, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _offer_tree(app: Sphinx, name: str, template: str, context: dict[str, Any], doctree: object) -> None:
    if "toctree" not in context:
        return
    env, complete_tree = app.env, context["toctree"]

    def tree(**wishes: Any) -> Any:
        if not wishes.get("titles_only"):
            return complete_tree(**wishes)
        complete, env.tocs = env.tocs, _tables_of_titles(app, env)
        try:
            return complete_tree(**wishes)
        finally:
            env.tocs = complete

    context["toctree"] = tree


def _tables_of_titles(app: Sphinx, env: BuildEnvironment) -> Tables:
    """The pages' tables of contents without their headings, made for the first page that is written."""
    found: Tables | None = getattr(app, "_tables_of_titles", None)
    if found is None:
        found = {name: _titles(table) for name, table in env.tocs.items()}
        app._tables_of_titles = found  # type: ignore[attr-defined]
    return found


def _titles(table: nodes.bullet_list) -> nodes.bullet_list:
    """A page's title, and the pages that it lists: what Sphinx leaves of a table of contents for `titles_only`."""
    titles = table.deepcopy()
    for item in titles.children:
        if isinstance(item, nodes.Element) and len(item) > 1:
            if listed := list(item.findall(addnodes.toctree)):
                item[1][:] = listed  # type: ignore[index]
            else:
                item.pop(1)
    return titles
