"""Test output streams, exit statuses, plugins and the reference page of the commands."""

import ast
import errno
import io
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.metadata import EntryPoint
from pathlib import Path

import click
import pandas as pd
import pytest
from cli_cases import one_line, robot, run, table, write

from gpmodel.api.calibrate import calibrate
from gpmodel.cli import main as cli
from gpmodel.cli import terminal
from gpmodel.cli.console import session_note
from gpmodel.cli.main import main
from gpmodel.errors import InputError
from gpmodel.files import locked_folder
from gpmodel.mechanism import source as plugins
from gpmodel.model.described import KINDS, SOLVED
from gpmodel.table.dataset import LABELS, READINGS

COMMANDS = sorted((Path(__file__).parents[2] / "gpmodel" / "cli").glob("*.py"))
SAVING = ("report", "save", "write_text", "write_frame", "write_report", "write_results")


@pytest.mark.parametrize("path", COMMANDS, ids=lambda p: p.stem)
def test_nothing_is_printed_before_all_is_saved(path: Path) -> None:
    """Read from the source: in a function every call that saves stands above every one that prints."""
    for function in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(function, ast.FunctionDef):
            printed, saved = [0, 10**6], [0]
            for call in (node for node in ast.walk(function) if isinstance(node, ast.Call)):
                name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
                to_stderr = any(k.arg == "err" for k in call.keywords)
                printed += [call.lineno] if name == "echo" and not to_stderr else []
                saved += [call.lineno] if name in SAVING else []
            first = sorted(printed)[1]
            returned = [n.lineno for n in ast.walk(function) if isinstance(n, ast.Return) and n.lineno > first]
            assert max(saved) < first or min(returned, default=10**6) < max(saved), f"{path.name}, {function.name}"
    assert "click.echo" not in path.read_text(encoding="utf-8") or path.stem == "terminal"


class Raw(io.RawIOBase):
    """A sink that takes nothing while it is broken."""

    def __init__(self, error: int) -> None:
        self.error, self.taken = error, b""

    def writable(self) -> bool:
        return True

    def write(self, content: bytes) -> int:  # type: ignore[override]
        if self.error:
            raise OSError(self.error, "No space left on device" if self.error == errno.ENOSPC else "Broken pipe")
        self.taken += bytes(content)
        return len(content)


STREAMS = {
    "full disk": (errno.ENOSPC, "utf-8", 2),
    "closed pipe": (errno.EPIPE, "utf-8", 0),
    "cp1252": (0, "cp1252", 0),
}


@contextmanager
def printed_to(kind: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[Raw]:
    error, encoding, _ = STREAMS[kind]
    raw = Raw(error)
    stream = io.TextIOWrapper(io.BufferedWriter(raw), encoding=encoding)
    monkeypatch.setattr(sys, "stdout", stream)
    yield raw
    raw.error = 0
    stream.detach().detach()


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a table, a later table, and two results."""
    folder = tmp_path_factory.mktemp("given")
    mechanism, made = robot(40, effects=("joint_compliance J2=2e-6",))
    write(table(40, effects=("joint_compliance J2=2e-6",)), folder / "table.csv")
    write(table(20, seed=1, effects=("joint_compliance J2=2e-6",)), folder / "later.csv")
    fit = calibrate(mechanism, made.dataset, ["joint_compliance J2"])
    for name in ("a", "b"):
        (folder / name).mkdir()
        fit.model.save(folder / name / "model.json")
        from gpmodel.api.results import write_numbers

        write_numbers(fit.record, fit.model, folder / name)
    return folder


SAVES = {
    "simulate": (["simulate", "--mechanism", "irb6400r", "--poses", "5", "--out", "OUT/s.csv"], "s.csv"),
    "check": (["check", "TABLE", "--mechanism", "irb6400r", "--out", "OUT"], "check.json"),
    "predict": (["predict", "A/model.json", "TABLE", "--out", "OUT/p.csv"], "p.csv"),
    "calibrate": (["calibrate", "TABLE", "--mechanism", "irb6400r", "--out", "OUT"], "model.json"),
    "compare": (["compare", "A", "B", "--out", "OUT"], "compare.html"),
    "explain": (["explain", "A", "1", "--out", "OUT"], "finding_1.html"),
    "verify": (["verify", "A/model.json", "LATER", "--out", "OUT"], "verify.json"),
    "compensate": (["compensate", "A/model.json", "TABLE", "--out", "OUT/c.csv"], "c.csv"),
    "certificate": (["certificate", "A", "--out", "OUT"], "certificate.html"),
    "export": (["export", "A", "--nodes", "2", "--out", "OUT"], "exports/model.c"),
    "poses": (["poses", "--mechanism", "irb6400r", "-n", "5", "--out", "OUT/q.csv"], "q.csv"),
}

QUICK = ("simulate", "check")
RUNS = [
    pytest.param(command, kind, marks=() if command in QUICK else pytest.mark.long)
    for command in SAVES
    for kind in STREAMS
    if command in QUICK or kind != "closed pipe"
]


@pytest.mark.first(3)
@pytest.mark.parametrize(("command", "kind"), RUNS)
def test_what_was_done_is_kept_whatever_becomes_of_the_output(
    command: str,
    kind: str,
    given: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words, file = SAVES[command]
    places = {
        "TABLE": given / "table.csv",
        "LATER": given / "later.csv",
        "A": given / "a",
        "B": given / "b",
        "OUT": tmp_path / "out",
    }
    words = ["/".join(str(places.get(part, part)) for part in word.split("/")) for word in words]
    with printed_to(kind, monkeypatch) as raw, pytest.raises(SystemExit) as ended:
        main(words)
    said = capsys.readouterr().err
    assert "defect" not in said
    assert "Traceback" not in said
    assert (tmp_path / "out" / file).exists()
    if kind == "full disk":
        assert "standard output: No space left on device; files are written" in said
    if kind == "cp1252":
        assert raw.taken.decode("cp1252")
    assert ended.value.code == STREAMS[kind][2] or (command, ended.value.code) == ("verify", 3)


def test_printed_text_steers_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.echo("a\x1b[31m\x07\x9b\u202e\u2028b\tc\nµ ± σ → 你\u00a0")
    assert capsys.readouterr().out == "a\\x1b[31m\\x07\\x9b\\u202e\\u2028b\tc\nµ ± σ → 你\u00a0\n"


def test_calibrate_keeps_out_of_a_folder_where_a_search_is_running(given: Path, tmp_path: Path) -> None:
    with locked_folder(tmp_path / "out"):
        line = one_line(run("calibrate", given / "table.csv", "--mechanism", "irb6400r", "--out", tmp_path / "out"), 2)
    assert "another gpmodel process uses this folder" in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("link", ["dangling", "circular", "below"])
def test_a_link_to_nothing_is_refused_before_the_work(link: str, given: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.symlink_to(out if link == "circular" else tmp_path / "nowhere")
    target = out / "deeper" if link == "below" else out
    line = one_line(run("calibrate", given / "no.csv", "--mechanism", "irb6400r", "--out", target), 2)
    assert f"{out} is a link to nothing; expected a folder" in line


LEAN = """
import sys
for name in ("sympy", "jinja2", "matplotlib"):
    sys.modules[name] = None
from gpmodel.cli.main import main
main(sys.argv[1:])
"""


@pytest.mark.long
def test_without_what_draws_pages_the_model_is_saved_and_the_extra_named(given: Path, tmp_path: Path) -> None:
    words = ["calibrate", given / "table.csv", "--mechanism", "irb6400r", "--out", tmp_path / "out"]
    done = subprocess.run([sys.executable, "-c", LEAN, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "without pages: a report needs " in done.stderr
    assert "pip install 'gpmodel[report]', then gpmodel report" in done.stderr
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"model.json", "report.json"}
    assert run("report", tmp_path / "out").exit_code == 0
    assert run("predict", tmp_path / "out" / "model.json", given / "table.csv").exit_code == 0


@pytest.mark.long
def test_a_model_is_saved_where_no_page_can_be_made(
    given: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse() -> None:
        raise InputError("a report needs sympy: pip install 'gpmodel[report]'")

    monkeypatch.setattr("gpmodel.cli.calibrate.check_writable", refuse)
    done = run("calibrate", given / "table.csv", "--mechanism", "irb6400r", "--out", tmp_path / "out", "--quiet")
    assert done.exit_code == 0, done.stderr
    assert "holds the model without pages: a report needs sympy" in done.stderr
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"model.json", "report.json"}


def test_what_belongs_to_a_session_is_said_once_and_not_wave_by_wave() -> None:
    waves = tuple(f"walk of the instrument, shift T{axis}, wave {k}" for axis in "xyz" for k in range(1, 9))
    note = session_note((*waves, "drift of the set-up Rz"), session=True)
    assert note.endswith(": walk of the instrument, shift, drift of the set-up Rz")


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two models of one table that predict other points."""
    folder = tmp_path_factory.mktemp("models")
    mechanism, made = robot(40)
    for name, kept in (("a", 40), ("b", 30)):
        calibrate(mechanism, made.dataset[:kept], []).model.save(folder / f"{name}.json")
    return folder / "a.json", folder / "b.json"


@cache
def measured() -> pd.DataFrame:
    return table(6)


@pytest.mark.parametrize("command", ["predict", "compensate"])
@pytest.mark.parametrize("columns", ["joints", pytest.param("all", marks=pytest.mark.long)])
def test_another_model_on_the_output_of_the_first_gives_its_own_numbers(
    command: str, columns: str, models: tuple[Path, Path], tmp_path: Path
) -> None:
    first, second = models
    given = measured() if columns == "all" else measured().filter(like="J").assign(note="first", status="bad")
    write(given, tmp_path / "given.csv")
    wanted = tmp_path / "wanted.csv"
    for model, source, out in ((first, "given", "once"), (second, "once", "twice"), (second, "given", "wanted")):
        done = run(command, model, tmp_path / f"{source}.csv", "--out", tmp_path / f"{out}.csv")
        assert done.exit_code == 0, done.stderr
    once, twice, wanted = (pd.read_csv(tmp_path / f"{name}.csv", dtype=str) for name in ("once", "twice", "wanted"))
    if command == "predict" and columns == "joints":  # x, y, z stand in the table now, as if they were measured
        wanted = wanted.rename(columns={f"{a} [mm]": f"predicted_{a} [mm]" for a in "xyz"})
        twice = twice.drop(columns=[f"{a} [mm]" for a in "xyz"])
    assert set(twice) == set(wanted)
    pd.testing.assert_frame_equal(twice[list(wanted)], wanted)
    assert not once.filter(regex="^corrected_|^predicted_|^sigma").equals(
        twice.filter(regex="^corrected_|^predicted_|^sigma")
    )
    assert (
        twice[list(given.columns.drop("status", errors="ignore"))] == given.drop(columns="status", errors="ignore")
    ).all(axis=None)


@pytest.mark.parametrize("stale", [{"corrected_J1 [deg]": 77}, {"corrected_J1 [rad]": 1.5}, {"status": "bad"}])
def test_a_stale_result_among_targets_is_no_result(
    stale: dict[str, object], models: tuple[Path, Path], tmp_path: Path
) -> None:
    targets = measured().filter(like="J")
    outputs = []
    for frame in (targets, targets.assign(**stale)):
        write(frame, tmp_path / "targets.csv")
        done = run("compensate", models[0], tmp_path / "targets.csv")
        assert done.exit_code == 0, done.stderr
        outputs.append(done.stdout)
    assert outputs[0] == outputs[1]


def test_compensate_states_the_error_of_orientation_that_remains(models: tuple[Path, Path], tmp_path: Path) -> None:
    write(measured().filter(like="J").assign(**{"J5 [deg]": 0.02}), tmp_path / "targets.csv")
    done = run("compensate", models[0], tmp_path / "targets.csv", "--out", tmp_path / "corrected.csv")
    remains = pd.read_csv(tmp_path / "corrected.csv")["residual_turn [mrad]"].max()
    assert remains > 1e-2
    assert f"up to {remains:.4f} mrad of the orientation not reached" in " ".join(done.output.split())


def test_command_of_another_package_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    plugin = EntryPoint("extra", "cli_plugin:extra", cli.PLUGINS)

    @click.command()
    def extra() -> None:
        click.echo("from outside")

    monkeypatch.setattr(EntryPoint, "load", lambda self: extra)
    monkeypatch.setattr(cli, "entry_points", lambda group, name="extra": [plugin] if name == "extra" else [])
    assert "\n  extra" in run("--help").stdout
    assert run("extra").stdout == "from outside\n"


def test_mechanisms_are_asked_of_every_provider(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, str | None, object]] = []

    def nobody(name: str, *, frame: str | None = None, payload_com: object = None) -> None:
        asked.append((name, frame, payload_com))

    providers = [EntryPoint(n, "gpmodel.errors:load_mechanism", plugins.PROVIDERS) for n in ("one", "two")]
    monkeypatch.setattr(plugins, "entry_points", lambda group: providers)
    monkeypatch.setattr(EntryPoint, "load", lambda self: nobody)
    with pytest.raises(InputError, match="'ghost' is unknown"):
        plugins.load_mechanism("ghost", frame="tip", payload_com=(0, 0, 1))
    assert asked == [("ghost", "tip", (0, 0, 1))] * 2


def test_an_unknown_mechanism_is_answered_with_those_of_every_provider_that_are_like_it() -> None:
    with pytest.raises(InputError, match=r"one of irb6400r, .* others"):
        plugins.load_mechanism("irb6400")
    with pytest.raises(InputError, match=r"one of hexapod, .* others"):
        plugins.load_mechanism("hexapode")


def test_broken_provider_is_named_only_when_nobody_knows(monkeypatch: pytest.MonkeyPatch) -> None:
    real = plugins.entry_points(group=plugins.PROVIDERS)
    broken = EntryPoint("broken", "no_such_module:load", plugins.PROVIDERS)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [broken, *real])
    assert plugins.load_mechanism("irb6400r").name == "irb6400r"
    with pytest.raises(InputError, match="provider 'broken' cannot be loaded"):
        plugins.load_mechanism("ghost")


PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "formats.md").read_text(encoding="utf-8")
CELLS = [line.strip("| ").split(" | ")[0] for line in PAGE.splitlines() if line.startswith("| ")]
FIRST = {word for cell in CELLS for part in re.findall(r"`([^`]+)`", cell) for word in part.split()}
"""The words in code in the first cells of all rows."""
POINT = ("x", "y", "z", "rx", "ry", "rz", "payload", "distance_*")


@pytest.mark.parametrize("column", [*LABELS, *READINGS, *POINT])
def test_every_column_of_a_table_has_a_row(column: str) -> None:
    assert column in FIRST


def test_every_option_of_every_command_has_a_row() -> None:
    root = click.Context(main)
    commands = {name: main.get_command(root, name) for name in main.list_commands(root)}
    options = {
        (name, flag)
        for name, command in commands.items()
        for option in (command.params if command else ())
        if isinstance(option, click.Option)
        for flag in option.opts
    }
    assert len(options) > 100
    assert {(name, flag) for name, flag in options if flag not in FIRST} == set()
    assert {name for name in commands if f"`gpmodel {name}" not in PAGE} == set()


def test_what_files_describe_is_said_with_its_words() -> None:
    assert {f"--{kind}" for kind in KINDS} <= FIRST
    assert [word for word in SOLVED if f'"{word}"' not in PAGE] == []
