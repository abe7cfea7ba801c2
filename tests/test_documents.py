"""What the documents tell people to do: code runs, commands and files are there."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from drm_baselines.support.extras import EXTRAS

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *ROOT.glob("examples/*.md")])
LIVING = [page for page in PAGES if page.name != "CHANGELOG.md"]

SMALLER = {
    "num_envs=1024": "num_envs=8",
    "n=1000": "n=8",
    "n_envs=32": "n_envs=2",
    "n_steps=128, batch_size=256": "n_steps=32, batch_size=16",
    ".learn(250_000)": ".learn(2)",
}
"""What the code of the README has, and what it is run with."""


def blocks(page: Path, *languages: str) -> Iterator[str]:
    """Yield the fenced blocks of a page in one of the languages."""
    found = re.findall(r"^```(\w*)\n(.*?)^```$", page.read_text(encoding="utf-8"), re.S | re.M)
    for language, text in found:
        if language in languages:
            yield text


def commands(page: Path) -> Iterator[str]:
    """Yield the commands in fenced and indented blocks of a page, without comments."""
    lines = [line for block in blocks(page, "sh", "bash") for line in block.splitlines()]
    lines += re.findall(r"^    (drm .*|make .*)$", page.read_text(encoding="utf-8"), re.M)
    for line in lines:
        for command in re.split(r";|&&", line.split(" #")[0]):
            if command.strip():
                yield command.strip()


def all_commands(program: str) -> list[str]:
    return [
        command for page in LIVING for command in commands(page) if command.split()[0] == program
    ]


# --- code -----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_code_of_the_readme_runs(tmp_path: Path) -> None:
    """All blocks one after the other, as somebody types them."""
    code = "\n".join(blocks(ROOT / "README.md", "python"))
    for large, small in SMALLER.items():
        assert large in code, f"the README has no {large!r} any more"
        code = code.replace(large, small)
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", "-c", code],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert list(tmp_path.iterdir()) == []


# --- commands -------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", all_commands("drm"))
def test_a_command_is_one_that_drm_takes(command: str) -> None:
    """Read by the command line itself, up to where the work would begin."""
    import typer

    from drm_baselines.cli import app

    group: Any = typer.main.get_command(app)
    words = shlex.split(command)[1:]
    # places that the text around a command defines
    words = [word.replace("$learners", "learners") for word in words]
    chosen = group.commands[words[0]]
    context = chosen.make_context(words[0], words[1:])
    assert not context.args


@pytest.mark.slow
def test_a_light_command_of_the_readme_does_what_it_says(tmp_path: Path) -> None:
    program = "from drm_baselines.cli import main; main()"
    for command in (
        "drm simulate --law lyapunov --mass-error 0.15 --out flight",
        "drm modes --payload-mass 200",
    ):
        assert command in all_commands("drm")
        done = subprocess.run(
            [sys.executable, "-c", program, *shlex.split(command)[1:]],
            cwd=tmp_path, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
    assert {path.name for path in (tmp_path / "flight").iterdir()} == {
        "lyapunov.csv", "simulation.json", "manoeuvre.png",
    }  # fmt: skip


def options_of(command: str) -> set[str]:
    import typer

    from drm_baselines.cli import app

    group: Any = typer.main.get_command(app)
    return {name for each in group.commands[command].params for name in each.opts}


def test_commands_in_running_text_exist_with_their_options() -> None:
    import typer

    from drm_baselines.cli import app

    group: Any = typer.main.get_command(app)
    found = 0
    for page in PAGES:
        for text in re.findall(r"`drm ([a-z][^`]*)`", page.read_text(encoding="utf-8")):
            command, *words = text.split()
            assert command in group.commands, (page.name, text)
            for word in words:
                if word.startswith("--"):
                    assert word.strip(".,") in options_of(command), (page.name, text)
                    found += 1
    assert found > 20


def test_make_has_every_target_that_is_named() -> None:
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.M))
    text = "\n".join(page.read_text(encoding="utf-8") for page in LIVING)
    named = set(re.findall(r"`make ([a-z]+)`|^make ([a-z]+)", text, re.M))
    words = {word for pair in named for word in pair if word}
    assert {"demo", "test", "lint"} <= words <= targets


def test_the_extras_of_the_readme_are_all_there_are() -> None:
    table = (ROOT / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \|", table.split("./baselines[...]", 1)[1], re.M)
    assert set(rows[: len(EXTRAS) + 1]) == {*EXTRAS, "all"}


# --- files ----------------------------------------------------------------------------------------

_PLACE = re.compile(
    r"`((?:\.github|baselines|docs|drm_env|examples|python|tests|tools)/[\w./*-]+|[A-Z]+\.md)`"
)


@pytest.mark.parametrize("page", LIVING, ids=lambda page: page.name)
def test_files_that_a_page_names_are_there(page: Path) -> None:
    for place in _PLACE.findall(page.read_text(encoding="utf-8")):
        if re.fullmatch(r"drm_env/\w+-v\d", place):
            continue  # the id of an environment
        assert list(ROOT.glob(place.rstrip("/").replace("NAME", "*"))), f"{page.name} names {place}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_of_a_page_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), f"{page.name} links to {target}"
