"""Look for dead links in a built site: files and anchors that its pages point to.

    tools/check_site.py DIRECTORY

Sphinx checks the links of its own pages; this looks at what was written, so at links into the
engine's pages and at pictures too. Links into the engine's own pages are not followed further.
"""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

OTHERS = ("rust",)
"""Folders whose pages another program wrote and checked."""


class Page(HTMLParser):
    """Links and anchors of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__(convert_charrefs=True)
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what the tag points to, and how it can be pointed to."""
        for name, value in attrs:
            if not value:
                continue
            if name == "id" or (tag == "a" and name == "name"):
                self.anchors.add(value)
            elif name in ("href", "src"):
                self.links.append(value)


def dead_links(site: Path) -> list[str]:
    """Return ``page: link`` for each link of the site's pages that leads nowhere."""
    pages = {
        path.resolve(): Page(path)
        for path in sorted(site.rglob("*.html"))
        if path.relative_to(site).parts[0] not in OTHERS
    }
    found = []
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if target.is_dir():
                target /= "index.html"
            dead = not target.exists()
            if not dead and parts.fragment and target in pages:
                dead = unquote(parts.fragment) not in pages[target].anchors
            if dead:
                found.append(f"{path.relative_to(site.resolve())}: {link}")
    return found


def main() -> int:
    """Check the site that the command line names."""
    if len(sys.argv) != 2 or not Path(sys.argv[1]).is_dir():
        print(__doc__, file=sys.stderr)
        return 2
    found = dead_links(Path(sys.argv[1]))
    for line in found:
        print(line, file=sys.stderr)
    print(f"{len(found)} dead links in {sys.argv[1]}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
