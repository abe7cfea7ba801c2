"""How every ``drm`` command meets its terminal: what it prints, where, and how it ends."""

from __future__ import annotations

import ast
import json
import os
import re
import select
import signal
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import pytest
import typer
from rich.table import Table
from typer.models import OptionInfo
from typer.testing import CliRunner, Result

import drm_baselines
from drm_baselines.cli import app, terminal
from drm_baselines.cli.common import ending_well, parse_value
from drm_baselines.errors import BaselineError
from drm_baselines.support import memory
from drm_baselines.support.interruption import Stopped, exit_code, stop_on_signal
from drm_baselines.support.reading import (
    MAX_DIGITS,
    MAX_NESTING,
    parse_json,
    parse_toml,
    read_table,
)

COMMANDS: dict[str, Any] = {
    command.callback.__name__: command.callback
    for command in app.registered_commands
    if command.callback is not None
}
HEAVY = (
    "clarabel", "drm_env", "gymnasium", "jinja2", "matplotlib", "numba", "numpy", "optuna",
    "pandas", "piqp", "pyarrow", "safetensors", "scipy", "stable_baselines3", "tensorboard",
    "torch",
)  # fmt: skip
DRM = "from drm_baselines.cli import main; main()"

posix = pytest.mark.skipif(os.name != "posix", reason="descriptors and signals of POSIX")


def drm(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def refuse(*arguments: object) -> str:
    """Run a command that must be refused; return its message, which is no traceback."""
    result = drm(*arguments)
    assert result.exit_code == 2, result.output
    assert result.exception is None or isinstance(result.exception, SystemExit)
    return " ".join(result.stderr.split())


def process(
    *arguments: object, program: str = DRM, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Run ``drm`` in a process of its own, whose end is part of the matter."""
    done = subprocess.run(
        [sys.executable, "-c", program, *map(str, arguments)],
        **{"capture_output": True, "text": True, "check": False, "timeout": 300, **options},
    )
    assert "Traceback" not in (done.stderr or "")
    assert "Exception ignored" not in (done.stderr or "")
    return done


# --- help


def test_help_and_refused_command_lines_import_nothing_heavy() -> None:
    lines = [["--help"], ["-h"], ["train"], ["info", "--nonsense"], ["nonsense"]]
    lines += [[command, "--help"] for command in COMMANDS]
    program = f"""
import sys
from drm_baselines.cli import app
for line in {lines!r}:
    try:
        app(line)
    except SystemExit:
        pass
    found = sorted(set({HEAVY!r}) & sys.modules.keys())
    assert not found, (line, found)
"""
    done = process(program=program)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("command", [[], *([name] for name in COMMANDS)])
def test_h_is_help(command: list[str]) -> None:
    short, long = drm(*command, "-h"), drm(*command, "--help")
    assert (short.exit_code, short.stdout) == (0, long.stdout)
    assert "Usage:" in short.stdout


def test_version_names_both_packages() -> None:
    import drm_env

    result = drm("--version")
    assert result.exit_code == 0
    assert drm_baselines.__version__ in result.stdout
    assert drm_env.__version__ in result.stdout


def options_of(command: str) -> dict[str, Any]:
    """The options of a command with their types."""
    found = {}
    for name, kind in get_type_hints(COMMANDS[command], include_extras=True).items():
        if get_origin(kind) is Annotated and isinstance(kind.__metadata__[0], OptionInfo):
            option = kind.__metadata__[0]
            names = [option.default, *(option.param_decls or ()), f"--{name.replace('_', '-')}"]
            found[next(each for each in names if str(each).startswith("--"))] = get_args(kind)[0]
    return found


def test_json_is_a_flag_in_every_command() -> None:
    found = {name: options_of(name).get("--json") for name in COMMANDS}
    assert all(
        found[name] is bool for name in ("info", "simulate", "evaluate", "bench", "benchmark")
    )
    assert set(found.values()) == {bool, None}, found


def test_the_file_after_json_is_still_written_with_a_warning(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from drm_baselines.speed import sections
    from drm_baselines.speed.results import Section

    def run(name: str, bench: object) -> Section:
        return Section(name=name, title="", rows=[], notes=[])

    monkeypatch.setattr(sections, "run", run)
    old, new = tmp_path / "old.json", tmp_path / "new.json"
    result = drm("bench", "--only", "kernel", "--json", old)
    assert result.exit_code == 0
    assert "--json-file" in result.stderr
    assert drm("bench", "--only", "kernel", "--json-file", new).exit_code == 0
    printed = json.loads(drm("bench", "--only", "kernel", "--json").stdout)
    assert (
        json.loads(old.read_text()).keys() == json.loads(new.read_text()).keys() == printed.keys()
    )
    assert "unexpected argument" in refuse("bench", "stray")


def test_no_error_recommends_a_package_that_is_not_published() -> None:
    for root in ("baselines/drm_baselines", "python/drm_env"):
        for path in (Path(__file__).parents[3] / root).rglob("*.py"):
            found = re.search(r"pip install '?drm[-_]\w+", path.read_text(encoding="utf-8"))
            assert found is None, (path, found)


# --- one place that prints


def test_only_the_terminal_module_makes_consoles_and_prints() -> None:
    """A second console does not know of the progress bar, and would take brackets for markup."""
    package = Path(drm_baselines.__file__).parent
    for path in package.rglob("*.py"):
        if path in (package / "cli" / "terminal.py", package / "speed" / "memory_probe.py"):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                name = ast.unparse(node.func)
                assert name not in ("print", "Console", "typer.echo", "Text.from_markup"), path
                assert not name.startswith(("sys.stdout", "sys.stderr")), path
            if isinstance(node, ast.ImportFrom):
                assert node.module != "rich.markup", path


WEIRD = "a[/x][red]:smile:\x1b[31m"


@pytest.mark.parametrize("through", ["say", "show", "note", "complain", "say_files"])
def test_texts_are_printed_as_they_are(capsys: pytest.CaptureFixture[str], through: str) -> None:
    table = Table(WEIRD, title=WEIRD, caption=WEIRD, show_header=True)
    table.add_row(WEIRD)
    {
        "say": lambda: terminal.say(WEIRD),
        "show": lambda: terminal.show(table),
        "note": lambda: terminal.note(WEIRD),
        "complain": lambda: terminal.complain(WEIRD),
        "say_files": lambda: terminal.say_files([Path(WEIRD)]),
    }[through]()
    text = "".join(capsys.readouterr())
    assert text.count("a[/x][red]:smile:\\x1b[31m") == (4 if through == "show" else 1)
    assert "\x1b" not in text


def test_what_the_encoding_lacks_is_written_out(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path = tmp_path / "text"
    with path.open("w", encoding="ascii") as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        terminal.say("│ \udcff")
    assert path.read_text() == "\\u2502 \\udcff\n"


@posix
def test_bar_and_lines_do_not_run_into_each_other() -> None:
    """On a terminal, a line begins where nothing of the bar is left."""
    import pty

    program = """
import time
from drm_baselines.cli.terminal import complain, counting, note, say
with counting("[/x]") as progress:
    for done in range(8):
        progress("bar[/x]", done, 8)
        time.sleep(0.15)
        [say, note, complain, say][done % 4](f"<line {done}>")
"""
    master, slave = pty.openpty()
    child = subprocess.Popen(
        [sys.executable, "-c", program], stdin=slave, stdout=slave, stderr=slave,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "100"},
    )  # fmt: skip
    os.close(slave)
    content = b""
    while select.select([master], [], [], 60)[0]:
        try:
            piece = os.read(master, 1 << 16)
        except OSError:
            break
        if not piece:
            break
        content += piece
    assert child.wait(60) == 0, content
    os.close(master)
    text = content.decode()
    assert "bar[/x]" in text
    assert "Traceback" not in text
    # what is on a line of the terminal after the last time that it was erased
    lines = [line.split("\x1b[2K")[-1] for line in text.replace("\r", "\n").split("\n")]
    plain = [re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", line) for line in lines]
    found = [line for line in plain if "<line" in line]
    assert [line.removeprefix("error: ") for line in found] == [f"<line {n}>" for n in range(8)]


# --- output that cannot be written


def closed() -> None:
    os.close(1)


@posix
@pytest.mark.parametrize("arguments", [("info",), ("--help",), ("modes", "--json")])
def test_a_closed_output_is_an_error_of_one_line(arguments: tuple[str, ...]) -> None:
    done = process(*arguments, stdout=None, stderr=subprocess.PIPE, capture_output=False,
                   preexec_fn=closed)  # fmt: skip
    if arguments == ("--help",):
        return  # click prints nothing without an output, and says nothing
    assert done.returncode == 2
    assert done.stderr == "error: standard output cannot be written: it is closed\n"


@posix
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("arguments", [("info", "--options"), ("--help",), ("simulate", "--json")])
def test_a_full_disk_behind_the_output_is_an_error_of_one_line(arguments: tuple[str, ...]) -> None:
    with Path("/dev/full").open("w") as full:
        done = process(*arguments, stdout=full, stderr=subprocess.PIPE, capture_output=False)
    assert done.returncode == 2
    assert "No space left on device" in done.stderr
    assert done.stderr.count("\n") == 1


@posix
def test_a_pipe_that_nobody_reads_ends_quietly() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = process("info", stdout=writer, stderr=subprocess.PIPE, capture_output=False)
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, "")


@posix
def test_results_are_saved_although_nobody_reads_the_output(tmp_path: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    out = tmp_path / "flight"
    done = process("simulate", "--law", "none", "--out", out, stdout=writer,
                   stderr=subprocess.PIPE, capture_output=False)  # fmt: skip
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, "")
    assert {"none.csv", "simulation.json", "manoeuvre.png"} <= {p.name for p in out.iterdir()}


# --- being interrupted

INTERRUPTED_IMPORT = """
import os, signal, sys

class Hook:
    def find_spec(self, name, path=None, target=None):
        if name == {name!r}:
            os.kill(os.getpid(), signal.{signal})

sys.meta_path.insert(0, Hook())
from drm_baselines.cli import main
main()
"""


@posix
@pytest.mark.parametrize(
    ("name", "number", "arguments"),
    [
        ("typer", signal.SIGINT, ("info",)),
        ("drm_env", signal.SIGINT, ("info",)),
        ("matplotlib", signal.SIGINT, ("reproduce", "--list")),
        ("torch", signal.SIGINT, ("train", "--out", "nowhere")),
        ("drm_env", signal.SIGTERM, ("compare",)),
    ],
)
def test_ctrl_c_while_a_command_is_loading_ends_it_at_once(
    name: str, number: signal.Signals, arguments: tuple[str, ...], tmp_path: Path
) -> None:
    program = INTERRUPTED_IMPORT.format(name=name, signal=number.name)
    done = process(*arguments, program=program, cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (128 + number, "", "interrupted\n")
    assert not any(tmp_path.iterdir())


def test_signals_end_a_command_with_the_exit_code_of_a_shell() -> None:
    for error, code in ((KeyboardInterrupt(), 130), (Stopped(signal.SIGTERM), 143)):

        def fail(error: BaseException = error) -> None:
            raise error

        with pytest.raises(typer.Exit) as caught:
            ending_well(fail)
        assert caught.value.exit_code == code


@posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_first_signal_asks_to_stop(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with stop_on_signal() as stop:
        os.kill(os.getpid(), number)
        assert stop.wait(10)
        assert exit_code() == 128 + number
        if number == signal.SIGINT:
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(number)
        else:  # a shell that goes away may send it twice
            signal.raise_signal(number)
    assert signal.getsignal(number) is before


@posix
def test_a_signal_that_is_ignored_stays_ignored() -> None:
    """As nohup has it."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stop_on_signal() as stop:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not stop.wait(0.1)
    finally:
        signal.signal(signal.SIGHUP, before)


# --- texts and files that somebody else wrote

LONG = "7" * 5000


def nested(levels: int, text: str = "1") -> str:
    return '{"a":' * levels + text + "}" * levels


def test_nesting_is_read_to_its_limit_and_no_further() -> None:
    assert parse_json(nested(MAX_NESTING))
    assert parse_toml("a" + ".a" * (MAX_NESTING - 1) + " = 1")
    for text in (nested(MAX_NESTING + 1), nested(100_000), "[" * 1_000_000):
        with pytest.raises(ValueError, match="nested more than"):
            parse_json(text)
    for text in ("a" + ".a" * MAX_NESTING + " = 1", "a = " + "[" * 100_000 + "]" * 100_000,
                 "a" + ".a" * 20_000 + " = 1"):  # fmt: skip
        with pytest.raises(ValueError, match="nested more than"):
            parse_toml(text)


def test_numbers_are_read_to_their_limit_and_no_further() -> None:
    most = "7" * MAX_DIGITS
    assert parse_json(most) == parse_toml(f"a = {most}")["a"] == int(most)
    for text in ("7" + most, LONG, "-" + LONG, "1e999"):
        with pytest.raises(ValueError, match="too large"):
            parse_json(text)
        with pytest.raises(ValueError, match="too large"):
            parse_toml(f"a = [{text}]")


@pytest.mark.parametrize("text", [LONG, '{"log_uniform": [1, ', nested(40), '"', "[1, NaN]"])
def test_values_that_look_like_json_and_are_none_are_refused(text: str) -> None:
    with pytest.raises(BaselineError, match="cannot be read as JSON") as caught:
        parse_value(text)
    assert len(str(caught.value)) < 300


BAD_FILES = {
    "deep": (nested(10_000), "a = " + "[" * 10_000 + "]" * 10_000, "nested more than"),
    "long": ('{"horizon": ' + LONG + "}", "horizon = " + LONG, "5000 digits"),
    "cut": ("{", "[payload", "cannot be read"),
    "no text": ("\x80", "\x80", "cannot be read"),
    "no table": ("[1, 2]", None, "must hold a table"),
    "twice": ('{"a": 1, "a": 2}', "a = 1\na = 2", "cannot be read"),
}


@pytest.mark.parametrize("kind", BAD_FILES)
@pytest.mark.parametrize("suffix", [".json", ".toml"])
def test_files_that_no_command_can_use_are_refused_by_name(
    tmp_path: Path, kind: str, suffix: str
) -> None:
    as_json, as_toml, message = BAD_FILES[kind]
    text = as_json if suffix == ".json" else as_toml
    if text is None:
        pytest.skip("TOML holds a table always")
    path = tmp_path / f"bad{suffix}"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(BaselineError, match=message):
        read_table(path)
    lines = [("simulate", path)]
    if suffix == ".toml":
        rest = ("--out", tmp_path / "run", "--hyperparameters", path)
        lines += [("train", *rest), ("tune", "ppo", *rest)]
    else:
        (tmp_path / "run.json").write_text(text, encoding="latin-1")
        lines += [("train", "--resume", "--out", tmp_path)]
        (tmp_path / "settings.json").write_text(text, encoding="latin-1")
        lines += [("tune", "linear", "--out", tmp_path)]
    for line in lines:
        assert message in refuse(*line), line
    assert not (tmp_path / "run").exists()


def test_a_directory_or_nothing_in_the_place_of_a_file_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "folder.json"
    folder.mkdir()
    assert "Is a directory" in refuse("simulate", folder) or os.name != "posix"
    assert "no scenario file" in refuse("simulate", tmp_path / "none.toml")


@pytest.mark.parametrize(
    "text", [f"payload_mass={LONG}", f"horizon={LONG}", f"payload_mass={nested(50)}"]
)
def test_set_refuses_numbers_and_nesting_that_no_option_has(text: str) -> None:
    message = refuse("info", "--set", text)
    assert message.startswith("error: --set")
    assert len(message) < 300


# --- counts


@pytest.mark.parametrize(
    "arguments",
    [
        ("evaluate", "--policy", "none", "--episodes"),
        ("compare", "--episodes"),
        ("demo", "--episodes"),
        ("train", "--evaluation-episodes"),
    ],
)
def test_more_episodes_than_fit_are_refused_before_anything_happens(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    if arguments[0] == "train":
        pytest.importorskip("stable_baselines3")
    monkeypatch.setattr(memory, "available", lambda: 1 << 30)
    out = tmp_path / "out"
    place = () if arguments[0] == "evaluate" else ("--out", out)
    message = refuse(*arguments, 90_000_000, *place)
    assert "of memory" in message
    assert "90,000,000 episodes" in message
    assert not out.exists()


def test_flights_that_do_not_fit_are_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(memory, "available", lambda: 1 << 30)
    out = tmp_path / "out"
    message = refuse("simulate", "--horizon", 1e6, "--out", out)
    assert "3 flights of 1e+06 s, decimation 5, would take about 112 GiB of memory" in message
    assert not out.exists()


def test_a_flight_is_written_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from drm_baselines.cli import simulate

    out = tmp_path / "out"
    monkeypatch.setattr(simulate, "_ROWS", 7)
    options = ("--law", "none", "--horizon", 1, "--decimation", 1)
    assert drm("simulate", *options, "--out", out).exit_code == 0
    rows = (out / "none.csv").read_text().splitlines()
    times = [float(row.split(",")[0]) for row in rows[1:]]
    assert times == pytest.approx([0.002 * k for k in range(501)])


def test_memory_is_judged_by_what_is_available(monkeypatch: pytest.MonkeyPatch) -> None:
    room = memory.available()
    if room is not None:
        assert 1 << 20 < room < 1 << 50
    monkeypatch.setattr(memory, "available", lambda: 3 << 30)
    memory.require(3 << 30, "it")
    with pytest.raises(BaselineError, match=r"it would take about 4 GiB of memory, and 3 GiB are"):
        memory.require(4 << 30, "it")
    monkeypatch.setattr(memory, "available", lambda: None)
    memory.require(1 << 60, "it")


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_a_count_beyond_all_counts_is_refused(command: str, tmp_path: Path) -> None:
    """Every whole number that an option takes: no traceback, and nothing made."""
    needed = {"train": ["--out", "out"], "imitate": ["--out", "out"], "tune": ["linear"],
              "evaluate": ["--policy", "none"]}.get(command, [])  # fmt: skip
    counts = [
        name for name, kind in options_of(command).items() if "int" in re.findall(r"\w+", str(kind))
    ]
    assert counts or command in ("info", "benchmark", "reproduce")
    for name in counts:
        arguments = [command, *needed, name, "9" * 30]
        if name == "--modes":
            arguments.append("4")
        if command == "tune" and name == "--steps":
            arguments[1] = "ppo"
        here = Path.cwd()
        os.chdir(tmp_path)
        try:
            message = refuse(*arguments)
        finally:
            os.chdir(here)
        assert "rror" in message, (name, message)
        assert not any(tmp_path.iterdir()), name


# --- paths


@pytest.mark.parametrize("name", ["a[/x]b", "[bold]", "two words", "naïve"])
def test_results_go_to_any_path(tmp_path: Path, name: str) -> None:
    out = tmp_path / name
    for arguments in (
        ("simulate", "--law", "none", "--out", out / "simulate"),
        ("evaluate", "--policy", "none", "--episodes", 2, "--out", out / "a.json",
         "--records", out / "a.csv"),
        ("compare", "none", "linear", "--episodes", 2, "--out", out / "compare"),
        ("modes", "--plot", out / "plot.png"),
        ("reproduce", "--only", "table-2-9", "--out", out / "thesis"),
        ("tune", "linear", "--trials", 1, "--scenarios", 4, "--out", out / "tune"),
        ("bench", "--list"),
    ):  # fmt: skip
        result = drm(*arguments)
        assert result.exit_code == 0, (arguments, result.output)
        if arguments[0] != "bench":
            assert name in result.stdout, arguments


@pytest.mark.parametrize("option", ["--out", "--records"])
def test_a_place_that_cannot_be_written_is_refused_before_flying(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, option: str
) -> None:
    from drm_baselines.evaluation import contestants

    def never(*_: object, **__: object) -> None:
        raise AssertionError("flown")

    monkeypatch.setattr(contestants, "fly_all", never)
    (tmp_path / "file").write_text("")
    place = tmp_path / "file" / "x.csv"
    message = refuse("evaluate", "--policy", "none", option, place)
    assert "cannot be written" in message
    assert "x.csv" in message


# --- the shell


def completions(line: str) -> set[str]:
    """What bash offers at the end of a line, by the script of `drm --install-completion`."""
    program = "import sys; sys.argv[0] = 'drm'; from drm_baselines.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={
            **os.environ,
            "_DRM_COMPLETE": "complete_bash",
            "COMP_WORDS": line,
            "COMP_CWORD": str(len(line.split(" ")) - 1),
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert not done.stderr
    return set(done.stdout.split())


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("drm comp", {"compare"}),
        ("drm compare ly", {"lyapunov", "lyapunov_filtered", "lyapunov_tuned"}),
        ("drm simulate --law se", {"servo", "servo_lean_zvd", "servo_zv", "servo_zvd"}),
        ("drm info --env drm_env/SlewR", {"drm_env/SlewResidual-v0", "drm_env/SlewResidual-v1"}),
        # the directory of a run: the shell's own files
        ("drm compare ./runs", set()),
    ],
)
def test_a_shell_completes_commands_options_policies_and_environments(
    line: str, offered: set[str]
) -> None:
    assert completions(line) == offered
