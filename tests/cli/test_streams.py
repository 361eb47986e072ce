"""Results of a command are saved before anything is printed, and no output stream can lose them."""

import ast
import errno
import io
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from cli_cases import one_line, robot, run, table, write

from gpmodel.api.calibrate import calibrate
from gpmodel.cli import terminal
from gpmodel.cli.main import main
from gpmodel.errors import InputError
from gpmodel.files import alone_in

COMMANDS = sorted((Path(__file__).parents[2] / "gpmodel" / "cli").glob("*.py"))
SAVING = ("report", "save", "write_text", "write_frame", "write_report", "discover_request")


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
    """A folder with a table and two results."""
    folder = tmp_path_factory.mktemp("given")
    mechanism, made = robot(40, effects=("joint_compliance J2=2e-6",))
    write(table(40, effects=("joint_compliance J2=2e-6",)), folder / "table.csv")
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
    "verify": (["verify", "A/model.json", "TABLE", "--out", "OUT"], "verify.json"),
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
    places = {"TABLE": given / "table.csv", "A": given / "a", "B": given / "b", "OUT": tmp_path / "out"}
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
    with alone_in(tmp_path / "out"):
        line = one_line(run("calibrate", given / "table.csv", "--mechanism", "irb6400r", "--out", tmp_path / "out"), 2)
    assert "another gpmodel is at work in it" in line
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
