"""Rough and long runs: commands that are killed and started again, steps without an end.

Each command runs once undisturbed. Then it is started again and again: at a random moment of its
work (seeded) it gets a SIGKILL, is started anew as a user would, and so on until it ends by itself.
What it has left must be what the undisturbed run left; no process of it may live on, and no
temporary file may stay. Then a batch is stepped a hundred million times, and its memory must not
grow. Prints tables; the exit code says whether anything was lost.

    python tools/soak.py --kills 20              # make soak
    python tools/soak.py --kills 1 --only tune
    python tools/soak.py --only steps --steps 1e7
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

LIMIT = 600.0
"""Seconds after which a command is said to hang."""
HYPERPARAMETERS = """\
algorithm = "ppo"
n_envs = 4
learning_rate = 1e-3

[model]
n_steps = 16
batch_size = 32
n_epochs = 1

[network]
layers = [8]
activation = "tanh"
"""


def drm(*arguments: object) -> list[str]:
    """Return the command line of the ``drm`` command."""
    program = "from drm_baselines.cli import main; main()"
    return [sys.executable, "-c", program, *map(str, arguments)]


@dataclass(frozen=True)
class Case:
    """A command under attack.

    Attributes
    ----------
    start, again
        Command lines for a directory: the first, and the one after a kill, which is told the
        directory and says what a user would.
    result
        What must be as in the undisturbed run, from its directory.
    """

    start: Callable[[Path], list[str]]
    again: Callable[[Path], list[str]]
    result: Callable[[Path], Any]


@dataclass
class Tally:
    """What was done to a command, and what came of it."""

    runs: int = 0
    kills: int = 0
    orphans: int = 0
    leftovers: int = 0
    faults: list[str] = field(default_factory=list)
    seconds: float = 0.0


def _train(out: Path) -> list[str]:
    settings = out.parent / "ppo.toml"
    settings.write_text(HYPERPARAMETERS)
    return drm(
        "train", "--out", out, "--steps", 3072, "--evaluations", 6, "--evaluation-episodes", 4,
        "--hyperparameters", settings, "--set", "horizon=0.4",
    )  # fmt: skip


def _train_again(out: Path) -> list[str]:
    if not (out / "run.json").is_file():
        return _train(out)
    return drm("train", "--resume", "--out", out)


def _train_result(out: Path) -> Any:
    from drm_baselines import load_policy

    record = json.loads((out / "run.json").read_text())
    policy = load_policy(out)
    with (out / "evaluations.csv").open(newline="") as stream:
        steps = [row["steps"] for row in csv.DictReader(stream)]
    checkpoints = sorted(path.name for path in (out / "checkpoints").iterdir())
    named = sorted(Path(entry["file"]).name for entry in record["checkpoint"].values())
    # episodes after resuming are drawn anew: everything but the digits of the weights
    return {
        "status": record["status"], "steps": record["steps"], "config": record["config"],
        "curve": steps, "policy": policy.description["training"]["steps"],
        "checkpoints": checkpoints == named,
    }  # fmt: skip


def _tune(out: Path) -> list[str]:
    return drm("tune", "linear", "--scenarios", 64, "--trials", 12, "--out", out)


def _tune_result(out: Path) -> Any:
    with (out / "trials.csv").open(newline="") as stream:
        rows = [{**row, "seconds": ""} for row in csv.DictReader(stream)]
    gains = json.loads((out / "gains.json").read_text())
    return rows, gains["law"], gains["objective"], gains["trials"]


def _imitate(out: Path) -> list[str]:
    return drm(
        "imitate", "--out", out, "--teacher", out.parent / f"{out.name}-teacher", "--scenarios", 4,
        "--rounds", 2, "--manoeuvres", 4, "--refine", 2, "--settle", 2, "--batch", 4,
    )  # fmt: skip


def _imitate_result(out: Path) -> Any:
    from drm_baselines import load_policy

    description = load_policy(out).description
    with (out / "evaluations.csv").open(newline="") as stream:
        rows = [{**row, "wall_time": ""} for row in csv.DictReader(stream)]
    return description["weights_sha256"], description["training"]["finished"], rows


def _benchmark(out: Path) -> list[str]:
    policies = ("none", "linear", "lyapunov", "linear_tuned")
    return drm(
        "benchmark", "--suite", "thesis", *(x for name in policies for x in ("--policy", name)),
        "--out", out,
    )  # fmt: skip


def _benchmark_result(out: Path) -> Any:
    from drm_baselines.benchmark.records import read_record

    found = {}
    for path in sorted((out / "records").rglob("*.parquet")):
        record = read_record(path)
        metrics = {name: values.tobytes() for name, values in record.metrics.items()}
        stamp = json.loads(path.with_suffix(".json").read_text())
        found[path.name] = (metrics, record.strata, stamp)
    return found, (out / "benchmark.html").is_file()


def _reproduce(out: Path) -> list[str]:
    names = ("table-2-9", "figure-4.38", "figure-4.63", "erratum-tip-law")
    return drm("reproduce", *(x for name in names for x in ("--only", name)), "--out", out)


def _reproduce_result(out: Path) -> Any:
    return {path.name: path.read_bytes() for path in out.iterdir() if path.name[0] != "."}


def _sweep(out: Path) -> list[str]:
    # two blocks of each
    return drm(
        "sweep", "--law", "linear", "--law", "lqr", "--episodes", 10_000, "--out", out,
        "--set", "horizon=4.0",
    )  # fmt: skip


def _sweep_result(out: Path) -> Any:
    import pandas as pd

    parts = sorted((out / "episodes").rglob("*.parquet"))
    tables = {str(path.relative_to(out)): pd.read_parquet(path) for path in parts}
    found = {name: table.to_dict("list") for name, table in tables.items()}
    summary = json.loads((out / "summary.json").read_text())
    del summary["provenance"]  # names the directory
    return repr(found), summary, (out / "tip_error.png").is_file()


CASES: Mapping[str, Case] = {
    "train": Case(_train, _train_again, _train_result),
    "tune": Case(_tune, _tune, _tune_result),
    "imitate": Case(_imitate, _imitate, _imitate_result),
    "benchmark": Case(_benchmark, _benchmark, _benchmark_result),
    "reproduce": Case(_reproduce, _reproduce, _reproduce_result),
    "sweep": Case(_sweep, _sweep, _sweep_result),
}

STEPS = "steps"
"""What is asked for with ``--only`` beside the commands."""
ENVIRONMENTS = 1024
"""Environments in the batch that is stepped long."""
GROWTH = 4 << 20
"""Bytes that a process may grow by after the first tenth of its steps."""


def run(
    command: Sequence[str], out: Path, kill_at: float | None
) -> tuple[int | None, str, float, int]:
    """Run a command, killed so many seconds after it began to write if it lives by then.

    Returns its exit code (none: killed), what it said, how long it worked after the directory was
    there, and the number of the process, which leads a session. Where the directory is there
    already, the time counts from the start of the process.
    """
    log = out.parent / f"{out.name}.log"
    there = out.exists()
    with log.open("w") as stream:
        process = subprocess.Popen(
            command, stdout=stream, stderr=subprocess.STDOUT, start_new_session=True
        )
        began = time.monotonic()
        # what is there of before says nothing: the second start counts from the process' start
        working: float | None = began if there else None
        try:
            while process.poll() is None:
                now = time.monotonic()
                if working is None and out.exists():
                    working = now
                if kill_at is not None and working is not None and now - working >= kill_at:
                    process.kill()
                    process.wait()
                    return None, log.read_text(), now - working, process.pid
                if now - began > LIMIT:
                    raise TimeoutError(f"{command} hangs: {log.read_text()[-400:]}")
                time.sleep(0.002)
        finally:
            process.kill()
            process.wait()
    return process.returncode, log.read_text(), time.monotonic() - (working or began), process.pid


def attack(case: Case, place: Path, kills: int, rng: random.Random) -> Tally:
    """Kill a command so many times; return what came of it."""
    tally = Tally()
    began = time.monotonic()
    reference = place / "undisturbed"
    started = time.monotonic()
    code, said, working, _ = run(case.start(reference), reference, None)
    whole = time.monotonic() - started
    if code != 0:
        tally.faults.append(f"undisturbed: exit code {code}: {said[-400:]}")
        return tally
    expected = case.result(reference)
    while tally.kills < kills and not tally.faults:
        out = place / f"run-{tally.runs}"
        tally.runs += 1
        for attempt in range(1000):
            command = (case.again if attempt else case.start)(out)
            # a first start by the time that it writes, a later one by its own
            span = working if attempt == 0 else whole
            moment = rng.uniform(0.0, span) if tally.kills < kills else None
            code, said, _, leader = run(command, out, moment)
            tally.orphans += orphans_of(leader)
            if code is not None:
                break
            tally.kills += 1
        # killed when all was done: the command says so, and the result must be there all the same
        done = code == 2 and attempt > 0 and ("has all of its" in said or "not empty" in said)
        if code != 0 and not done:
            tally.faults.append(f"{out}: exit code {code}: {said[-400:]}")
            break
        try:
            found = case.result(out)
        except Exception as error:
            tally.faults.append(f"{out}: {error!r}")
            break
        if found != expected:
            tally.faults.append(f"{out}: another result than undisturbed")
        tally.leftovers += sum(1 for _ in out.rglob(".drm-*"))
        tally.leftovers += sum(1 for _ in out.rglob(".drm.work.json"))
    tally.seconds = time.monotonic() - began
    return tally


def session_of(leader: int) -> list[int]:
    """Return the living processes of a session, by the number of its first process."""
    found = []
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == leader and fields[0] not in ("Z", "X"):
            found.append(int(entry.name))
    return found


def orphans_of(leader: int, patience: float = 10.0) -> int:
    """Return how many processes of a session outlive its first for long, and end them."""
    deadline = time.monotonic() + patience
    while (found := session_of(leader)) and time.monotonic() < deadline:
        time.sleep(0.05)
    for process in found:
        os.kill(process, signal.SIGKILL)
    return len(found)


def memory() -> int:
    """Return the memory that this process has in use, bytes."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


@dataclass
class Walk:
    """What came of stepping a batch for long; memory in bytes after the first tenth and later."""

    steps: int
    episodes: int
    samples: list[int]
    seconds: float

    @property
    def growth(self) -> int:
        """Bytes that the process was larger by than after the first tenth of the steps."""
        return max(self.samples) - self.samples[0]


def walk(steps: int) -> Walk:
    """Step a batch so many times: episodes end and begin, contexts change, snapshots come back."""
    import numpy as np

    import drm_env

    env = drm_env.DrmVectorEnv(
        ENVIRONMENTS, horizon=4.0, payload_mass=(50.0, 500.0), mass_error=(-0.15, 0.15)
    )
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1.0, 1.0, (16, ENVIRONMENTS, 2)).astype(np.float32)
    env.reset(seed=0)
    rounds = -(-steps // ENVIRONMENTS)
    tenth = max(1, rounds // 10)
    samples: list[int] = []
    episodes = 0
    began = time.monotonic()
    for i in range(rounds):
        observations, rewards, terminated, truncated, _ = env.step(actions[i % len(actions)])
        episodes += int(np.count_nonzero(terminated | truncated))
        if i % 1000 == 999:
            if not (np.isfinite(observations).all() and np.isfinite(rewards).all()):
                raise AssertionError(f"round {i}: a number is not finite")
            env.set_state(env.get_state())
        if i % 5000 == 4999:
            masses = rng.uniform(50.0, 500.0, ENVIRONMENTS)
            env.reset(seed=i, options={"payload_mass": masses})
        if i + 1 >= tenth and (i + 1) % max(1, tenth // 4) == 0:
            samples.append(memory())
    env.close()
    return Walk(rounds * ENVIRONMENTS, episodes, samples, time.monotonic() - began)


def walk_apart(steps: int) -> bool:
    """Step long in a process of its own, print what came of it, and say whether memory grew."""
    program = (
        f"import json, soak; w = soak.walk({steps}); "
        "print(json.dumps([w.steps, w.episodes, w.samples, w.seconds]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=Path(__file__).parent, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    if done.returncode:
        print(done.stderr, file=sys.stderr)
        return False
    found = Walk(*json.loads(done.stdout))
    mib = [sample / (1 << 20) for sample in (found.samples[0], found.samples[-1])]
    print("\n| steps | episodes | MiB after a tenth | MiB at the end | growth, MiB | seconds |")
    print("| --: | --: | --: | --: | --: | --: |")
    print(
        f"| {found.steps:,} | {found.episodes:,} | {mib[0]:.1f} | {mib[1]:.1f} | "
        f"{found.growth / (1 << 20):.2f} | {found.seconds:.0f} |",
        flush=True,
    )
    return found.growth <= GROWTH


def main() -> int:
    """Attack the commands, step long, and print tables."""
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("--kills", type=int, default=20, help="SIGKILLs for each command")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--steps", type=float, default=1e8, help="steps of the long run")
    parser.add_argument(
        "--only", action="append", choices=[*sorted(CASES), STEPS], help="these commands, or steps"
    )
    arguments = parser.parse_args()
    wanted = arguments.only or [*CASES, STEPS]
    lost = 0
    if any(name in CASES for name in wanted):
        lost += attack_all([name for name in wanted if name in CASES], arguments)
    if STEPS in wanted and not walk_apart(int(arguments.steps)):
        lost += 1
    return 1 if lost else 0


def attack_all(names: Sequence[str], arguments: argparse.Namespace) -> int:
    """Attack commands and print a table; return how much was lost or stayed behind."""
    lost = 0
    print("| command | runs | SIGKILLs | processes left | files left | lost | seconds |")
    print("| --- | --: | --: | --: | --: | --: | --: |")
    with tempfile.TemporaryDirectory(prefix="drm-soak-") as folder:
        os.environ["XDG_STATE_HOME"] = str(Path(folder) / "state")
        for name in names:
            place = Path(folder) / name
            place.mkdir()
            rng = random.Random(f"{arguments.seed} {name}")
            tally = attack(CASES[name], place, arguments.kills, rng)
            print(
                f"| `drm {name}` | {tally.runs} | {tally.kills} | {tally.orphans} | "
                f"{tally.leftovers} | {len(tally.faults)} | {tally.seconds:.0f} |",
                flush=True,
            )
            for fault in tally.faults:
                print(fault, file=sys.stderr)
            lost += len(tally.faults) + tally.orphans + tally.leftovers
    return lost


if __name__ == "__main__":
    sys.exit(main())
