"""Sphinx configuration: MyST Markdown pages, executed notebooks, formulas as MathML.

Browsers render MathML without a library, so the built pages work offline.
"""

import os
import re
import shutil
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math import latex2mathml
from numpy.typing import ArrayLike
from sphinx.addnodes import pending_xref_condition
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.typing import stringify_annotation

import lis_grasp

# Sphinx reads below this folder only. A symbolic link would hide notebooks/ from hatchling.
_HERE = Path(__file__).parent
shutil.rmtree(_HERE / "notebooks", ignore_errors=True)
shutil.copytree(
    _HERE.parent / "notebooks",
    _HERE / "notebooks",
    ignore=shutil.ignore_patterns(".ipynb_checkpoints"),
)

WORDS = 45_000
logger = logging.getLogger(__name__)

project = "lis_grasp"
copyright = "the lis_grasp developers"
release = version = lis_grasp.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinxarg.ext",
    "sphinx_design",
    "sphinx_llm_friendly",
]
exclude_patterns = ["_build"]

# Docstrings name code in single backticks.
default_role = "py:obj"
# Pages name the members that they show: a default would replace those names.
autodoc_default_options = {"member-order": "bysource"}
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
_ALIASES = ("FloatArray", "IndexArray", "ArrayLike", "Estimator", "Runner", "StopRule")
autodoc_type_aliases = {name: name for name in _ALIASES}
autodoc_preserve_defaults = True
autodoc_mock_imports = ["mujoco", "coacd"]  # optional
napoleon_google_docstring = False
napoleon_attr_annotations = False  # autodoc adds all types
napoleon_use_rtype = False
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3


# Show figures in the page, also when MPLBACKEND is set in the shell.
os.environ["MPLBACKEND"] = "module://matplotlib_inline.backend_inline"
nb_execution_mode = "cache"
nb_execution_raise_on_error = True
nb_execution_timeout = 600
nb_merge_streams = True

html_math_renderer = "mathml"
html_theme = "pydata_sphinx_theme"
html_title = f"lis_grasp {release}"
html_theme_options = {
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
    "show_prev_next": False,
}
html_sidebars = {page: [] for page in ("index", "install", "tutorial", "method", "results", "faq")}
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sourcelink = False


def write_inline(translator: Any, node: nodes.math) -> None:
    """Write an inline formula."""
    translator.body.append(latex2mathml.tex2mathml(node.astext()))
    raise nodes.SkipNode


def write_block(translator: Any, node: nodes.math_block) -> None:
    """Write a displayed formula."""
    formula = latex2mathml.tex2mathml(node.astext(), as_block=True)
    translator.body.append(f'<div class="math">{formula}</div>\n')
    raise nodes.SkipNode


# The names of types, where Sphinx writes what they stand for.
_ALIAS = re.compile(r"TypeAliasForwardRef\('(\w+)'\)")
_ARRAY_LIKE = stringify_annotation(ArrayLike, "smart")


def name_types(app: Sphinx, *_: object) -> None:
    """Write the aliases of types by their names; the signature shows which defaults are None."""
    for annotations in app.env.current_document.autodoc_annotations.values():
        for name, text in annotations.items():
            text = _ALIAS.sub(r"\1", text.replace(_ARRAY_LIKE, "ArrayLike"))
            annotations[name] = text.removesuffix(" | None")


def show_return(
    app: Sphinx, what: str, name: str, obj: Any, options: Any, signature: str, _: Any
) -> tuple[str, str] | None:
    """Move the type of what is returned from the description to the signature."""
    returned = app.env.current_document.autodoc_annotations.get(name, {}).pop("return", "None")
    return None if returned == "None" or signature is None else (signature, returned)


_PARAMETER = re.compile(r":param (\w+): *((?:.+\n?)(?:[ \t]+.*\n?)*)")


def say_once(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Let arguments that one entry describes together refer to the first of them."""
    first: dict[str, str] = {}

    def refer(match: re.Match[str]) -> str:
        argument, text = match[1], " ".join(match[2].split())
        if first.setdefault(text, argument) == argument or len(text.split()) < 6:
            return match[0]
        return f":param {argument}: See `{first[text]}`.\n"

    lines[:] = _PARAMETER.sub(refer, "\n".join(lines) + "\n").split("\n")


def _is_unseen(node: nodes.Node) -> bool:
    """Return whether a text is a cell's output, such as a scene, or the long name of a type."""
    while (node := node.parent) is not None:
        if isinstance(node, pending_xref_condition) and node["condition"] == "*":
            return True
        output = isinstance(node, nodes.Element) and node.get("nb_element") == "cell_code_output"
        if output or isinstance(node, nodes.raw):
            return True
    return False


def count_words(app: Sphinx, error: Exception | None) -> None:
    """Warn if all pages have more than WORDS words, or a page of the API hardly any."""
    if error is not None or app.builder.format != "html":
        return
    words = {
        name: sum(
            len(text.split())
            for text in app.env.get_doctree(name).findall(nodes.Text)
            if not _is_unseen(text)
        )
        for name in app.env.found_docs
    }
    for name, count in words.items():
        if name.startswith("reference/api/") and count < 100:
            logger.warning("%s has %d words: are its members named?", name, count)
    total = sum(words.values())
    print(f"{total} words on {len(words)} pages")
    if total > WORDS:
        longest = ", ".join(sorted(words, key=words.__getitem__, reverse=True)[:8])
        logger.warning("%d words, more than %d; the longest pages: %s", total, WORDS, longest)


def setup(app: Sphinx) -> None:
    """Register the MathML renderer and the count of words."""
    app.add_html_math_renderer("mathml", (write_inline, None), (write_block, None))
    app.connect("autodoc-process-docstring", say_once, priority=900)
    app.connect("autodoc-process-signature", show_return, priority=900)
    app.connect("object-description-transform", name_types, priority=400)
    app.connect("build-finished", count_words)
