"""The documentation as a site, for Sphinx: `make site`.

The checkout is the source folder, so that a link leads here where it leads on a forge.
"""

from sphinx.application import Sphinx

from rigctl import __version__

project = "rigctl"
html_title = f"rigctl {__version__}"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_argparse_cli"]
root_doc = "docs/README"
include_patterns = ["*.md", "arduino/*.md", "docs/*.md", "docs/*/*.md"]
myst_heading_anchors = 4
nitpicky = True
nitpick_ignore_regex = [("py:class", ".*")]  # types in signatures, most of which have no page
html_theme = "furo"
html_favicon = "../gui/rigctl.svg"
html_copy_source = False

SECTIONS = {
    "Tutorial": ("docs/tutorial/*",),
    "How-to": (
        *(f"docs/how-to/{page}" for page in ("paper-at-a-bench", "build-the-rig")),
        "arduino/README",
        *(f"docs/how-to/{page}" for page in ("set-up", "calibrate", "accept", "*")),
    ),
    "Reference": (
        *(f"docs/reference/{page}" for page in ("glossary", "command-line", "options", "api", "*")),
    ),
    "Explanation": ("docs/explanation/*",),
    "Project": ("README", "docs/decisions/README", "CONTRIBUTING", "CHANGELOG"),
}


def add_contents(app: Sphinx, page: str, source: list[str]) -> None:
    """Give the first page the contents, which would only disturb readers on a forge."""
    if page == app.config.root_doc:
        for title, pages in SECTIONS.items():
            names = "\n".join(f"/{name}" for name in pages)
            source[0] += f"\n```{{toctree}}\n:hidden:\n:glob:\n:caption: {title}\n{names}\n```\n"


def setup(app: Sphinx) -> None:
    """Connect what Sphinx calls."""
    app.connect("source-read", add_contents)
