"""Builds the documentation: `sphinx-build -n -W docs docs/_build`."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # what is documented is what lies here, installed or not

from sphinx.builders.html import StandaloneHTMLBuilder  # noqa: E402
from sphinx.ext.napoleon.docstring import GoogleDocstring  # noqa: E402

import servolink  # noqa: E402
from docs import command_pages, llms_txt, made_pages  # noqa: E402
from docs.accessible import accessible  # noqa: E402

if TYPE_CHECKING:
    from sphinx.addnodes import pending_xref
    from sphinx.application import Sphinx
    from sphinx.environment import BuildEnvironment

project = "servolink"
author = "The servolink authors"
copyright = f"2026, {author}"  # noqa: A001 - the name that Sphinx reads
version = release = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]

extensions = ["myst_parser", "sphinx.ext.autodoc"]
exclude_patterns = ["_build", "_static", "_templates"]
html_theme = "furo"
html_title = "servolink"
html_static_path = ["_static", "pictures/studio/live-dark.png"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_theme_options: dict[str, list[str]] = {"top_of_page_buttons": []}
templates_path = ["_templates"]
myst_heading_anchors = 3

nitpicky = True
nitpick_ignore_regex = [
    (
        "py:.*",
        r"(asyncio|collections|os|pathlib|types)\..*",
    ),  # Python's own documentation is not at hand during a build
    ("py:.*", r".*\.([MPRT](_co)?)"),  # type variables
    ("py:.*", r"servolink\.connection\.connection\.Connection"),  # only stands for the present connection
    ("py:.*", r"servolink\.hub\.rules\.tried\.MotionTwin"),  # the twin of the extra is the only one
    ("py:.*", r"servolink\.virtual\..*"),  # how the virtual board keeps what is stored
]

default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_maximum_signature_line_length = 80


def setup(app: Sphinx) -> None:
    """Let Sphinx find the public names, and read the sections of docstrings."""
    app.connect("builder-inited", prepare)
    app.connect("build-finished", complete)
    app.connect("missing-reference", resolve_public_name)
    app.connect("autodoc-process-docstring", read_sections)


def prepare(app: Sphinx) -> None:
    """Write what is made from the code alone, and let the template of all pages repair what the theme makes."""
    command_pages.write(command_pages.SITE, command_pages.site_pages())
    made_pages.write()
    if isinstance(app.builder, StandaloneHTMLBuilder):
        app.builder.templates.environment.filters["accessible"] = accessible


def complete(app: Sphinx, error: Exception | None) -> None:
    """Write the list of pages for programs that read, beside the pages."""
    if error is None and isinstance(app.builder, StandaloneHTMLBuilder):
        (Path(app.outdir) / "llms.txt").write_text(llms_txt.text(), encoding="utf-8")


def read_sections(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Turn sections such as Args and Raises into lists. Docstrings of attributes have none: "Seconds: ..." is text."""
    if what in {"class", "function", "method"}:
        lines[:] = GoogleDocstring(list(lines)).lines()


def resolve_public_name(app: Sphinx, env: BuildEnvironment, node: pending_xref, contents: Any) -> Any:
    """Lead from where a class is defined to where programs import it from."""
    module, _, name = node["reftarget"].rpartition(".")
    if not module.startswith("servolink.") or name not in servolink.__all__:
        return None
    place = node.get("refdoc", env.docname)
    return env.domains.python_domain.resolve_xref(env, place, app.builder, "obj", f"servolink.{name}", node, contents)
