"""Instructions of a step, counted by valgrind: the same in every run, whatever the machine does.

The count of a program with more steps minus that with fewer, divided by the difference, leaves
out what happens once. Valgrind knows no AVX-512, so the programs run with the instructions they
choose without it.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

from drm_baselines.errors import BaselineError
from drm_baselines.speed.reference import yardstick

_FEW, _MANY = 20_000, 60_000
_TIMEOUT = 300.0


class CountingError(BaselineError):
    """Instructions cannot be counted here; the message says what is missing."""


@dataclass(frozen=True)
class Count:
    """Instructions of a step an environment, and what the program says about itself."""

    instructions: float
    description: str


def kernel_example() -> Path:
    """Return the engine's example program ``kernel`` in the source checkout of this package.

    Raises
    ------
    CountingError
        No checkout, or the program has not been built.
    """
    name = Path("target", "release", "examples", "kernel")
    for directory in Path(__file__).resolve().parents:
        if (directory / "Cargo.toml").is_file():
            program = directory / name
            if program.is_file():
                return program
            break
    raise CountingError(
        f"{name} is not there: cargo build --release --example kernel makes it in a checkout"
    )


def valgrind() -> str:
    """Return the valgrind on the path.

    Raises
    ------
    CountingError
        There is none.
    """
    found = shutil.which("valgrind")
    if found is None:
        raise CountingError("no valgrind found")
    return found


def instructions_of(command: list[str]) -> tuple[int, str]:
    """Run a command under callgrind; return its instructions and what it printed.

    Raises
    ------
    CountingError
        Valgrind or the program fails.
    """
    with tempfile.TemporaryDirectory(prefix="drm-callgrind-") as directory:
        tool = [valgrind(), "--tool=callgrind", f"--callgrind-out-file={directory}/out"]
        try:
            done = subprocess.run(
                [*tool, *command], capture_output=True, text=True, timeout=_TIMEOUT
            )
        except (OSError, subprocess.SubprocessError) as error:
            raise CountingError(f"valgrind cannot be run: {error}") from error
    match = re.search(r"Collected\s*:\s*(\d+)", done.stderr)
    if done.returncode != 0 or match is None:
        last = done.stderr.strip().splitlines()[-1:] or ["no message"]
        raise CountingError(f"{Path(command[0]).name} under valgrind: {last[0]}")
    return int(match[1]), done.stdout.strip()


def count_engine(lanes: int, program: Path) -> Count:
    """Count the instructions of the engine's kernel; ``lanes`` is 1, or 0 for the widest pack.

    The first line that the program prints must hold its lanes, as in ``AVX2, lanes: 4``; it
    becomes the description.

    Raises
    ------
    CountingError
        It cannot be counted.
    """

    def run(steps: int) -> tuple[int, str]:
        return instructions_of([str(program), "--lanes", str(lanes), "--steps", str(steps)])

    (few, text), (many, _) = run(_FEW), run(_MANY)
    text = next(iter(text.splitlines()), "")
    used = re.search(r"lanes\W+(\d+)|(\d+)\s+lanes?", text)
    width = int(used[1] or used[2]) if used else max(1, lanes)
    if lanes == 0 and not used:
        raise CountingError(f"the kernel example does not say its lanes: {text[:80]!r}")
    description = " ".join(text.split()) or f"{width} lanes"
    return Count((many - few) / (_MANY - _FEW) / width, description)


def count_yardstick(lanes: int, *, axial: bool) -> Count:
    """Count the instructions of the C yardstick, compiled for what valgrind knows.

    Raises
    ------
    CountingError
        It cannot be counted.
    BaselineError
        It cannot be compiled.
    """
    machine = yardstick.portable_machine()
    if machine is None:
        raise CountingError("no instruction set is known that valgrind can run here")
    with yardstick.compiled(lanes, axial=axial, machine=machine) as built:
        (few, _), (many, _) = (
            instructions_of([str(built.program), str(repetitions)]) for repetitions in (1, 3)
        )
    return Count((many - few) / (2 * yardstick.STEPS * lanes), machine)
