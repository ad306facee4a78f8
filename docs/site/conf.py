"""Settings of the site; Sphinx reads them, `make docs` calls it through stage.py."""

import re
import sys
from pathlib import Path
from typing import Any

import clothsim

sys.path.insert(0, str(Path(__file__).parent))
from pictures import PictureFiles

project = "clothsim"
author = "clothsim developers"
release = version = clothsim.__version__
extensions = ["sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode", "myst_nb", "sphinx_gallery.gen_gallery"]
root_doc = "index"
exclude_patterns = ["examples", "gallery/*.ipynb", "gallery/*.py", "**.md5"]

html_theme = "furo"
html_title = f"clothsim {version}"
html_show_copyright = False

# Docstrings write names and code between single backticks.
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the sections Parameters and Returns say the types
napoleon_use_ivar = True
napoleon_use_rtype = False
add_module_names = False

myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4
nb_execution_mode = "off"  # notebooks keep their outputs; tests/notebooks runs them
# The gallery's scraper is an object, which Sphinx cannot pickle.
suppress_warnings = ["config.cache"]

sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "image_scrapers": (PictureFiles(),),
    "within_subsection_order": "FileNameSortKey",
    "capture_repr": (),
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 10_000,
    "abort_on_example_error": True,
    "reset_modules": (),
    "remove_config_comments": True,
}


def one_attribute_each(app: Any, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Give each of `x, v : array` in a section Attributes its own entry: napoleon does so for parameters alone."""
    before, heading, section = "\n".join(lines).partition("Attributes\n----------\n")
    section, end, after = section.partition("\nExamples\n")
    entry = re.compile(r"^(\w+(?:, \w+)+)((?: :.*)?(?:\n    .*)*)", re.M)
    section = entry.sub(lambda found: "\n".join(each + found[2] for each in found[1].split(", ")), section)
    lines[:] = (before + heading + section + end + after).split("\n")


def setup(app: Any) -> None:
    """Change docstrings before napoleon, whose priority is 500."""
    app.connect("autodoc-process-docstring", one_attribute_each, priority=400)
