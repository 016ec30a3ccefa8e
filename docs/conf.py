"""How the pages in this folder are built: `make docs` writes them to build/docs.

Nothing is fetched: the theme brings its own files, formulas become MathML, and other projects' names stay plain text.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))  # so that the extensions beside this file are found

from servobench._version import __version__

project = "servobench"
author = "the servobench authors"
project_copyright = "the servobench authors, BSD-3-Clause"
version = release = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "_extensions.mathml",
    "_extensions.docstrings",
    "_extensions.navigation",
]
exclude_patterns = ["_extensions"]
templates_path: list[str] = []
nitpicky = True

myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 4  # the anchors that code hosts make, so that one link works on both
myst_links_external_new_tab = False
suppress_warnings = ["myst.strikethrough"]

html_theme = "furo"
html_title = f"servobench {version}"
html_static_path = ["_static"]
html_css_files = ["servobench.css"]
html_show_sphinx = False
html_copy_source = False
html_theme_options = {"navigation_with_keys": True, "top_of_page_buttons": []}
html_math_renderer = "mathml"
pygments_style = "friendly"
pygments_dark_style = "native"

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_class_signature = "mixed"
autodoc_default_options: dict[str, object] = {"members": True}
python_use_unqualified_type_names = True
default_role = "code"  # docstrings are read in the source: single backticks, as in the pages

autodoc_default_options |= {"no-value": True, "exclude-members": "model_config,model_post_init"}

# Aliases of types keep their names in signatures. What a name stands for is said in the module that defines it.
ALIASES = (
    "Array",
    "Mask",
    "Kind",
    "Output",
    "State",
    "Timing",
    "StopReason",
    "Table",
    "Cell",
    "Fact",
    "Watch",
    "Look",
    "Illustration",
    "Origin",
    "Name",
)
autodoc_type_aliases = {name: name for name in ALIASES}

# What annotations name and has no page: those aliases, and other projects' names. All else of ours has to be on one.
ELSEWHERE = (
    r"(Axes|pandas|numpy|np|pydantic|pydantic_core|collections|pathlib|os|types|typing|"
    r"scipy|control|abc|enum|NDArray|NoneType)"
)
nitpick_ignore = [("py:class", name) for name in ALIASES]
nitpick_ignore_regex = [
    ("py:.*", ELSEWHERE + r"\b.*"),
    ("py:.*", r".*\.T"),
    ("py:.*", r"(tuple|Mapping|dict)\[.*"),
]
