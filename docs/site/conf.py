"""Settings of the site; Sphinx reads them, `make docs` calls it through stage.py."""

import re
import sys
import warnings
from html import unescape
from pathlib import Path
from typing import Any

import clothsim
from docutils.nodes import FixedTextElement, Text, literal, math, raw, superscript
from latex2mathml.converter import convert
from numpy.typing import ArrayLike
from sphinx.addnodes import desc_annotation, desc_returns, desc_sig_name, desc_signature
from sphinx.util.typing import stringify_annotation

sys.path.insert(0, str(Path(__file__).parent))
from pictures import PictureFiles

project = "clothsim"
author = "clothsim developers"
release = version = clothsim.__version__
extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
]
extensions += ["myst_nb", "sphinx_gallery.gen_gallery"]
root_doc = "index"
exclude_patterns = ["examples", "gallery/**.ipynb", "gallery/**.py", "**.md5"]

html_theme = "furo"
html_title = f"clothsim {version}"
html_show_copyright = False
html_logo = html_favicon = "../images/logo.svg"
html_math_renderer = "mathml"
html_static_path = ["static"]
html_css_files = ["site.css"]

# Docstrings write names and code between single backticks.
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_type_aliases = {
    name: name for name in vars(clothsim.typing) if name[0].isupper() and name != "Any"
}
python_use_unqualified_type_names = True
autosummary_generate = False
napoleon_use_ivar = True
napoleon_use_rtype = False
add_module_names = False

myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 4
nb_execution_mode = "off"  # notebooks keep their outputs; tests/notebooks runs them
# The gallery's scraper is an object, which Sphinx cannot pickle.
suppress_warnings = ["config.cache"]

# The output of an example shows a warning without the path of its file.
warnings.formatwarning = lambda message, category, *_: f"{category.__name__}: {message}\n"

sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "image_scrapers": (PictureFiles(),),
    "within_subsection_order": "FileNameSortKey",
    "capture_repr": (),
    "download_all_examples": False,
    "write_computation_times": False,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 10_000,
    "abort_on_example_error": True,
    "reset_modules": (),
    "remove_config_comments": True,
}


def one_attribute_each(
    app: Any, what: str, name: str, value: Any, options: Any, lines: list[str]
) -> None:
    """Give each of `x, v : array` in a section Attributes its own entry: napoleon does so for
    parameters alone.
    """
    before, heading, section = "\n".join(lines).partition("Attributes\n----------\n")
    section, end, after = section.partition("\nExamples\n")
    entry = re.compile(r"^(\w+(?:, \w+)+)((?: :.*)?(?:\n    .*)*)", re.M)
    section = entry.sub(
        lambda match: "\n".join(each_name + match[2] for each_name in match[1].split(", ")), section
    )
    lines[:] = (before + heading + section + end + after).split("\n")


def without_private(
    app: Any,
    what: str,
    name: str,
    value: Any,
    options: Any,
    signature: str | None,
    returned: str | None,
) -> Any:
    """Leave out parameters whose names begin with an underscore, or that only raise an error."""
    if signature:
        signature = re.sub(
            r", (?:\*\*)?(?:_\w+: [^,)=]+(?: = [^,)]+)?|\w+: NoReturn[^,)]*)(?=[,)])", "", signature
        )
    return signature, returned


def as_mathml(display: str) -> Any:
    """Typeset an equation as MathML, which browsers show without a script."""

    def visit(translator: Any, node: Any) -> None:
        from docutils.nodes import SkipNode

        tag = "div" if display == "block" else "span"
        formula = convert(node.astext(), display=display)
        translator.body.append(f'<{tag} class="formula">{formula}</{tag}>')
        raise SkipNode

    return visit


# What autodoc spells out of a type, and its name in the source.
TYPE_NAMES = {
    re.escape(re.sub(r"~[\w.]+\.", "", stringify_annotation(ArrayLike, "smart"))): "ArrayLike",
    r"ndarray\[tuple\[Any, \.\.\.\], dtype\[(\w+)\]\]": r"NDArray[\1]",
    r"TypeAliasForwardRef\('(\w+)'\)": r"\1",
    r"\bnpt?\.": "",
}


def name_types(app: Any, document: Any, page: str) -> None:
    """Write the types of signatures as the source does."""
    for signature in document.findall(desc_signature):
        for part in list(signature.findall(is_type)):
            text = spelled_out = "".join(child.astext() for child in part.children)
            for spelled, name in TYPE_NAMES.items():
                text = re.sub(spelled, name, text)
            if text != spelled_out:
                part.children = [Text(text)]


def is_type(node: Any) -> bool:
    return isinstance(node, (desc_sig_name, desc_returns, desc_annotation))


# A power in plain text, such as "m/s^2", "h^-1/2", "(x / h)**2" or "J^T".
POWER = re.compile(r"(?<=[\w)])(?:\^|\*\*)(-?[\d/]+|T\b)")


def raise_powers(app: Any, document: Any, page: str) -> None:
    """Typeset the powers of docstrings, which are written for `help()`."""
    for text in list(document.findall(Text)):
        if isinstance(text.parent, (FixedTextElement, literal, math, raw)):
            continue
        before, *parts = POWER.split(text)
        if parts:
            powers = [superscript(power, power) for power in parts[::2]]
            pieces = [piece for pair in zip(powers, map(Text, parts[1::2])) for piece in pair]
            text.parent.replace(text, [Text(before), *pieces])


def describe_thumbnails(app: Any, page: str, source: list[str]) -> None:
    """Give each thumbnail of the gallery its example's title as the text alternative."""
    source[0] = re.sub(
        r'(tooltip="([^"]+)">.*?:alt:)\n',
        lambda thumbnail: f"{thumbnail[1]} {unescape(thumbnail[2])}\n",
        source[0],
        flags=re.DOTALL,
    )


def setup(app: Any) -> None:
    """Change docstrings before napoleon, whose priority is 500, then what stands on pages."""
    app.connect("source-read", describe_thumbnails)
    app.connect("doctree-resolved", name_types)
    app.connect("doctree-resolved", raise_powers)
    app.connect("autodoc-process-docstring", one_attribute_each, priority=400)
    app.connect("autodoc-process-signature", without_private)
    app.add_html_math_renderer("mathml", (as_mathml("inline"), None), (as_mathml("block"), None))
