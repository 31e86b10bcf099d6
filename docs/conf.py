"""How Sphinx builds the documentation: ``sphinx-build -W docs out/docs``, without network."""

from __future__ import annotations

import sys
from pathlib import Path

from sphinx.application import Sphinx

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS.parent))

from docs import api_pages  # noqa: E402  # the path comes first

import trailmark  # noqa: E402  # isort's order

project, author, copyright = "trailmark", "the authors of trailmark", "the authors of trailmark"  # noqa: A001  # Sphinx's
version = release = trailmark.__version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
    "matplotlib.sphinxext.plot_directive",
]
exclude_patterns = ["gallery/*.ipynb", "gallery/*.py", "gallery/*.md5", "gallery/*.json", "gallery/*.zip"]
nitpicky = False

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
suppress_warnings = ["config.cache"]  # functions in the settings below cannot be pickled; nothing is cached but pages

html_theme = "furo"
html_title = "trailmark"
html_show_sphinx = False
html_theme_options = {"light_css_variables": {"color-brand-primary": "#0072b2", "color-brand-content": "#0072b2"}}

autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_type_aliases = {"ArrayLike": "ArrayLike"}  # not the union that it stands for
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_custom_sections = [("Modes", "params_style")]

plot_html_show_formats = plot_html_show_source_link = plot_include_source = False
plot_formats = [("png", 110)]

sphinx_gallery_conf = {
    "examples_dirs": str(DOCS.parent / "examples"),
    "gallery_dirs": "gallery",
    "filename_pattern": r"^(?!.*ros2_).*",  # that starts a node of ROS 2, which few machines have; its picture is kept
    "download_all_examples": False,
    "capture_repr": (),
    "show_signature": False,
    "remove_config_comments": True,
    "write_computation_times": False,  # its page loads scripts from elsewhere
    "within_subsection_order": "docs.api_pages.by_kind_of_use",
}

api_pages.write(DOCS / "api")
api_pages.write_commands(DOCS / "api" / "commands.md")


def setup(app: Sphinx) -> None:
    """Let docstrings and pages be written as they are."""
    app.connect("autodoc-process-docstring", api_pages.make_readable, priority=400)  # before napoleon's 500
    app.connect("missing-reference", api_pages.found_elsewhere)
