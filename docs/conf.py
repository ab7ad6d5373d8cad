"""The site of docs/: `make docs` builds it with Sphinx into out/site. Warnings are errors."""

from __future__ import annotations

import inspect
import re
import shutil
from pathlib import Path
from typing import Any

import latex2mathml.converter
from docutils import nodes
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst

import t2d_rt as t2d
from t2d_rt import dataset, learn, plots, signal

ROOT = Path(__file__).resolve().parents[1]
GENERATED = ROOT / "docs/generated"
PUBLIC = t2d, signal, plots, dataset, learn
"""Modules whose names have pages."""
REPORTS = re.compile(r"(?:\.\./)+validation/(report|bench)/")
ELSEWHERE = re.compile(r"\[([^\]]*)\]\((?:\.\./(?!\.)[^)]*|examples/[^)]*|[A-Z]+(?:\.(?:md|cff))?)\)")
"""Links to files that have no page; group 1 is what they say."""
FUNCTION = re.compile(r"(\\(?:sin|cos|tan|log)(?:\^\w)?) ?(?=[\w\\])(?!\\left)")
"""That its argument follows without brackets: a thin space comes between."""
OVERLINE = re.compile(r'<mover>((?:(?!<mover>).)*)<mo accent="true">&#x02015;</mo></mover>')
PARAMETER = re.compile(r"(\w+(?:, \w+)*): +(.*)")

_drawn: list[Figure] = []


def _last_figure(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """The figure that a block ends with, as a picture. The gallery itself finds those of pyplot alone."""
    found = block_vars["example_globals"].get("___")
    if not isinstance(found, Figure) or found in _drawn:
        return ""
    _drawn.append(found)
    path = next(block_vars["image_path_iterator"])
    found.savefig(path, dpi=110)
    plt.close(found)  # pyplot would keep it to the end
    return str(figure_rst([path], gallery_conf["src_dir"]))


project, author, version = "t2d-rt", "the t2d-rt authors", t2d.__version__
release = version
copyright = "2026, the t2d-rt authors"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_gallery.gen_gallery"]
root_doc = "index"
suppress_warnings = ["config.cache"]  # a function is in the configuration

html_math_renderer = "mathml"
html_static_path, html_css_files = ["static"], ["math.css"]
html_theme = "pydata_sphinx_theme"
html_title = "t2d-rt"
html_show_sourcelink = False
html_theme_options = {
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
    "show_prev_next": False,
    "pygments_light_style": "tango",
}
myst_enable_extensions = ["html_image", "attrs_inline", "dollarmath", "colon_fence"]
myst_heading_anchors = 4
myst_links_external_new_tab = True

default_role = "code"  # docstrings mark code by single backticks
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "exclude-members": "model_config, model_fields, model_post_init"}
python_maximum_signature_line_length = 90
autodoc_preserve_defaults = True

sphinx_gallery_conf = {
    "examples_dirs": [str(ROOT / "examples/tutorials"), str(ROOT / "examples/gallery")],
    "gallery_dirs": ["generated/tutorials", "generated/gallery"],
    "filename_pattern": r"\.py$",
    "within_subsection_order": "FileNameSortKey",
    "show_memory": False,
    "min_reported_time": 1e6,
    "abort_on_example_error": True,
    "download_all_examples": False,
    "remove_config_comments": True,
    "image_scrapers": (_last_figure,),
    "capture_repr": ("_repr_html_", "__str__"),
    "ignore_repr_types": r".*Figure",
}


def setup(app: Any) -> None:
    """Lets Sphinx write the pages that do not lie in docs/ before it reads any."""
    _copy_reports()
    _write_api()
    app.add_html_math_renderer("mathml", (_mathml, None), (_mathml, None))
    app.connect("source-read", _read_source)
    app.connect("autodoc-process-docstring", _parameters)


def _mathml(writer: Any, node: nodes.math | nodes.math_block) -> None:
    """Formulas in MathML, which browsers draw without scripts or network."""
    display = "block" if isinstance(node, nodes.math_block) else "inline"
    formula = FUNCTION.sub(r"\1\\,", node.astext().replace("{aligned}", "{align*}"))
    found = latex2mathml.converter.convert(formula, display=display)
    if "\\" in found:
        raise ValueError(f"a formula has a command that MathML lacks: {node.astext()}")
    # Bars over a product are as long as it is; those around a magnitude are as high as the line, and stand close to it.
    found = OVERLINE.sub(r'<mrow class="overline">\1</mrow>', found)
    found = found.replace("<mo>&#x0007C;</mo>", '<mo stretchy="false" lspace="0" rspace="0">|</mo>')
    writer.body.append(f'<div class="formula">{found}</div>' if display == "block" else found)
    raise nodes.SkipNode


def _copy_reports() -> None:
    for name in ("report", "bench"):
        (GENERATED / name).mkdir(parents=True, exist_ok=True)
        for path in (ROOT / "validation" / name).iterdir():
            if path.suffix in {".md", ".png"}:
                shutil.copy2(path, GENERATED / name / path.name)


def _read_source(app: Any, name: str, source: list[str]) -> None:
    """The README stands on the first page; links to files that are not in docs/ go to their copies, or are words."""
    text = source[0]
    if name == "index":
        readme = (ROOT / "README.md").read_text()
        text = readme.replace("(docs/", "(").replace('"docs/', '"').replace("(validation/", "(../validation/") + text
    text = REPORTS.sub(r"generated/\1/" if "/" not in name else r"\1/", text).replace("../../docs/", "../../")
    source[0] = ELSEWHERE.sub(r"\1", text) if "/" not in name else text


def _parameters(app: Any, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Makes fields of the lines "name: what it is" of a docstring, for names of parameters, also "one, other: what they are"."""
    try:
        parameters = {each.lstrip("*") for each in inspect.signature(value).parameters}
    except (TypeError, ValueError):
        parameters = set()
    found: list[str] = []
    for line in (each.replace("|", "\\|") for each in lines):
        named = PARAMETER.match(line)
        names = named[1].split(", ") if named else []
        if named and parameters.issuperset(names):
            if found and found[-1] and not found[-1].startswith((":param", " ")):
                found.append("")
            found += [f":param {each}: {named[2]}" for each in names]
        elif not set(line) <= {"-"} or not line:
            found.append(line)
    lines[:] = [each for each in found if each != "Parameters"]


def _write_api() -> None:
    """A page for each public name, and one that lists them with the first sentence of their docstrings."""
    folder = GENERATED / "api"
    folder.mkdir(parents=True, exist_ok=True)
    pages, tables = [], []
    for module in PUBLIC:
        within = module.__name__.removeprefix("t2d_rt").removeprefix(".")
        rows = [
            f"`{module.__name__}`",
            "-" * 40,
            "",
            (module.__doc__ or "").partition("\n\n")[0],
            "",
            ".. list-table::",
            "",
        ]
        for name in module.__all__:
            value = getattr(module, name)
            if not callable(value):
                continue
            kind, page = (
                "autoclass" if isinstance(value, type) else "autofunction",
                ".".join(filter(None, (within, name))),
            )
            text = f"{page}\n{'=' * len(page)}\n\n.. currentmodule:: {module.__name__}\n\n.. {kind}:: {name}\n"
            _write(folder / f"{page}.rst", text)
            first = (inspect.getdoc(value) or "").partition("\n\n")[0].replace("\n", " ").replace("|", "\\|")
            pages.append(f"   {page}")
            rows += [f"   * - :doc:`{name} <{page}>`", f"     - {first}"]
        tables += [*rows, ""]
    _write(folder / "index.rst", "\n".join(["API", "===", "", ".. toctree::", "   :hidden:", "", *pages, "", *tables]))


def _write(path: Path, text: str) -> None:
    """Only what has changed, so that Sphinx keeps the pages that have not."""
    if not path.exists() or path.read_text() != text:
        path.write_text(text)
