"""The documentation site: Sphinx on the Markdown pages of this folder (``make docs``).

Pages are read as they lie here, so that they read well on a code host too. Three things are done
to them on the way in: ``<!-- reference: NAME -->`` becomes what ``tools/reference.py`` says of the
installed packages, a page that begins with ``<!-- include: FILE -->`` becomes that file of the
root, and links to files of the root become links to their pages. Notebooks offer themselves for
download. A page that ``index.md`` does not list appears at the end of its last list.
"""

from __future__ import annotations

import json
import re
import sys
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
sys.path.insert(0, str(ROOT / "tools"))

import reference  # noqa: E402  # of tools/

import drm_env  # noqa: E402

project = "drm-env"
author = "drm-env contributors"
copyright = author  # noqa: A001  # Sphinx's name
version = release = drm_env.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
]
exclude_patterns = ["**/.ipynb_checkpoints"]
# `name` in a docstring means an argument, whatever else is called so
suppress_warnings = ["ref.python"]

myst_enable_extensions = ["attrs_block", "colon_fence"]
myst_heading_anchors = 4

# Notebooks are stored without outputs and run when the site is built.
nb_execution_mode = "force"
nb_execution_timeout = 600
nb_execution_raise_on_error = True
nb_merge_streams = True

autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_inherit_docstrings = False
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
napoleon_custom_sections = [
    "Action space",
    "Observation space",
    "Reward",
    "Start of an episode",
    "End of an episode",
    "Infos",
]
default_role = "py:obj"
smartquotes = False  # they make dashes of options
add_module_names = False

html_theme = "furo"
html_title = f"drm-env {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False
html_show_copyright = False
html_theme_options = {
    "light_css_variables": {
        "color-brand-primary": "#0072B2",
        "color-brand-content": "#0072B2",
    },
    "dark_css_variables": {
        "color-brand-primary": "#56B4E9",
        "color-brand-content": "#56B4E9",
    },
}
copybutton_exclude = ".linenos, .gp, .go"

PAGES_OF_ROOT = {
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "SECURITY.md": "security.md",
    "README.md": "index.md",
    "examples/README.md": "examples.md",
}
_LINK = re.compile(r"\]\((?!\w+:|#)([^)\s#]+)")


def _included(name: str) -> str:
    """A file of the root as a page of this folder: links lead from here."""
    text = (ROOT / name).read_text(encoding="utf-8")

    def from_here(found: re.Match[str]) -> str:
        target = found[1]
        inside = target.removeprefix("docs/")
        return f"]({inside if inside != target else '../' + target}"

    return _LINK.sub(from_here, text)


def _to_pages(found: re.Match[str]) -> str:
    page = PAGES_OF_ROOT.get(found[1].removeprefix("../"))
    return f"]({page}" if page and found[1].startswith("../") else found[0]


def _contents(text: str) -> str:
    """The page of contents: patterns stand for the pages that there are, the rest comes last."""
    names = sorted(page.stem for page in DOCS.glob("*.md") if page.stem != "index")
    lists = re.findall(r"^```\{toctree\}\n(.*?)^```", text, re.S | re.M)
    lines = [line for part in lists for line in part.split("\n\n", 1)[1].splitlines()]
    patterns = [re.sub(r".*<(.*)>", r"\1", line) for line in lines]
    listed = {name for name in names for pattern in patterns if fnmatchcase(name, pattern)}
    rest = [name for name in names if name not in listed]

    def pages(found: re.Match[str]) -> str:
        return "".join(f"{name}\n" for name in names if fnmatchcase(name, found[1]))

    text = re.sub(r"(?m)^([\w*]*\*)\n", pages, text)
    return text.replace("<!-- unlisted -->", "\n".join(rest))


def _with_download(text: str, name: str) -> str:
    """A notebook that offers itself, below its title."""
    notebook = json.loads(text)
    offer = f"\n\n{{download}}`Download this notebook <{name}.ipynb>`"
    notebook["cells"][0]["source"].append(offer)
    return json.dumps(notebook)


def _prepare(_app: Any, docname: str, source: list[str]) -> None:
    if (DOCS / f"{docname}.ipynb").is_file():
        source[0] = _with_download(source[0], Path(docname).name)
        return
    text = source[0]
    if docname == "index":
        text = _contents(text)
    if found := re.match(r"<!-- include: (\S+) -->", text):
        text = _included(found[1])
    text = re.sub(
        r"(?m)^<!-- reference: (\w+) -->$", lambda found: reference.section(found[1]), text
    )
    source[0] = _LINK.sub(_to_pages, text)


def setup(app: Any) -> dict[str, Any]:
    """Called by Sphinx."""
    app.connect("source-read", _prepare)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
