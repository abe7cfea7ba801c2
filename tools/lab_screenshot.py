"""Make the picture of the lab in docs/images: open the built page in Chromium and look at it.

    tools/lab_screenshot.py [PAGE] [OUTPUT] [--address TEXT] [--size W H] [--scheme light|dark]

The page is that of ``make lab``; Chromium is the system's.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def main() -> int:
    """Take the picture that the command line names."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("page", type=Path, nargs="?", default=ROOT / "site" / "lab" / "index.html")
    parser.add_argument(
        "output", type=Path, nargs="?", default=ROOT / "docs" / "images" / "lab.png"
    )
    parser.add_argument(
        "--address", default="t=9.5&b=none&error=15", help="what stands behind # (docs/lab.md)"
    )
    parser.add_argument("--size", type=int, nargs=2, default=(1360, 900), metavar=("W", "H"))
    parser.add_argument("--scheme", choices=("light", "dark"), default="light")
    arguments = parser.parse_args()
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        print("Chromium is missing: install it with 'apt-get install chromium'", file=sys.stderr)
        return 2
    if not arguments.page.is_file():
        print(f"there is no {arguments.page}: build it with 'make lab'", file=sys.stderr)
        return 2
    from playwright.sync_api import sync_playwright

    width, height = arguments.size
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=chromium,
            args=["--no-sandbox", "--disable-gpu", "--disable-background-networking"],
        )
        page = browser.new_page(
            viewport={"width": width, "height": height}, color_scheme=arguments.scheme
        )
        page.goto(f"{arguments.page.resolve().as_uri()}#{arguments.address}")
        flown = "html[data-state=flown]"
        page.wait_for_selector(flown, state="attached", timeout=120_000)
        for _ in range(4):  # until the browser has optimised the engine, whose times are shown
            page.dispatch_event("#option-mass", "input")
            page.wait_for_selector(flown, state="attached", timeout=120_000)
        page.screenshot(path=arguments.output)
        browser.close()
    print(arguments.output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
