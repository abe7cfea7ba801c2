"""Make the pictures of docs/reports.md: write small reports, open them in Chromium, look at them.

    tools/report_screenshots.py [DIRECTORY]

Pictures go to docs/images by default. Chromium is the system's; the reports are of a manoeuvre and
of a comparison of 40 episodes, which take seconds.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
DRM = Path(sys.executable).with_name("drm")
POLICIES = ("none", "linear", "lyapunov", "dagger")
REPORTS = {
    "simulation": [
        "simulate", "--payload-mass", "320", "--mass-error", "0.15",
        *(text for name in POLICIES for text in ("--law", name)),
    ],
    "comparison": ["compare", *POLICIES, "--episodes", "40"],
}  # fmt: skip
SEEK = "drm.flights[0].seek(9.4)"
FLIGHTS = "document.querySelector('#flights').scrollIntoView()"
SHOTS: tuple[tuple[str, str, str, tuple[int, int], tuple[str, ...]], ...] = (
    ("report_simulation", "simulation", "light", (1360, 1130), (SEEK,)),
    ("report_comparison", "comparison", "light", (1360, 1010), ()),
    ("report_phone", "simulation", "dark", (390, 844), (SEEK, FLIGHTS)),
)
"""Name of the picture, the report, its colours, the window (px), and what is done in the page."""


def take(
    browser: Any, report: Path, target: Path, scheme: str, size: tuple[int, int], acts: Any
) -> None:
    """Open a report, do something in it, and take a picture of the window."""
    width, height = size
    page = browser.new_page(
        viewport={"width": width, "height": height},
        color_scheme=scheme,
        device_scale_factor=2 if width < 500 else 1,
    )
    page.goto(report.as_uri())
    page.wait_for_selector("html[data-state=drawn]", state="attached")
    for act in acts:
        page.evaluate(act)
    page.wait_for_timeout(300)
    page.screenshot(path=target)
    page.close()


def main() -> int:
    """Make the pictures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("directory", type=Path, nargs="?", default=ROOT / "docs" / "images")
    arguments = parser.parse_args()
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        print("Chromium is missing: install it with 'apt-get install chromium'", file=sys.stderr)
        return 2
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        for name, command in REPORTS.items():
            file = Path(folder) / f"{name}.html"
            subprocess.run([DRM, *command, "--html", file], check=True, stdout=subprocess.DEVNULL)
        browser = playwright.chromium.launch(
            executable_path=chromium,
            args=["--no-sandbox", "--disable-gpu", "--disable-background-networking"],
        )
        for name, report, scheme, size, acts in SHOTS:
            target = arguments.directory / f"{name}.png"
            take(browser, Path(folder) / f"{report}.html", target, scheme, size, acts)
            print(target)
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
