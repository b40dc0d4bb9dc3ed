"""How Sphinx makes the site of this folder: scripts/site. Nothing is fetched from a network."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_site"), str(HERE.parent / "src")]

import blurmatte  # noqa: E402

project = "blurmatte"
author = "The blurmatte authors"
project_copyright = author
release = version = blurmatte.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
    "gallery_pictures",
    "project_pages",
    "reference",
]
exclude_patterns = ["_site", "generated/gallery/*.ipynb"]
nitpicky = True
language = "en"
smartquotes = False  # texts hold commands, to be copied

myst_heading_anchors = 4  # links such as cli.md#blurmatte-solve, as hosting platforms make them
myst_links_external_new_tab = False
suppress_warnings = ["config.cache"]

# Signatures without types: docstrings state them with shapes and units.
autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "generated/gallery",
    "filename_pattern": r"\.py",
    "ignore_pattern": r"figure\.py",
    "image_scrapers": ("gallery_pictures.scraper",),
    "reset_argv": "gallery_pictures.arguments",
    "reset_modules": (),
    "capture_repr": (),
    "within_subsection_order": "FileNameSortKey",
    "abort_on_example_error": True,
    "inspect_global_variables": False,
    "show_signature": False,
    "write_computation_times": False,
    "min_reported_time": 10_000,
    "thumbnail_size": (640, 440),
}

html_theme = "furo"
html_title = f"blurmatte {release}"
html_static_path = ["_static"]
templates_path = ["_templates"]
html_css_files = ["site.css"]
html_js_files = [("site.js", {"defer": "defer"})]
html_copy_source = False
html_show_sphinx = False
