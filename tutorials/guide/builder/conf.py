"""Settings of Sphinx."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import ngbrain

project = "ngbrain"
author = "The ngbrain developers"
version = release = ngbrain.__version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "docstrings", "mathml"]
exclude_patterns = ["lessons/notebooks"]
default_role = "code"
language = "en"

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "off"
nb_merge_streams = True
nb_ipywidgets_js = {}  # widgets would be fetched from a network
nb_mime_priority_overrides = [("html", "application/vnd.jupyter.widget-view+json", None)]

autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_default_options = {"no-value": True}
napoleon_google_docstring = False
napoleon_use_param = napoleon_use_rtype = False
napoleon_custom_sections = [("Attributes", "params_style")]

suppress_warnings = ["ref.python"]  # types in docstrings are words, several of which have namesakes

html_theme = "furo"
html_title = "ngbrain"
html_static_path = ["style"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_show_search_summary = False  # a summary is fetched, which browsers refuse for pages on disk
html_copy_source = html_show_sourcelink = False
html_show_sphinx = False
