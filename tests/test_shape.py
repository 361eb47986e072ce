"""Test lengths of files and functions, numbers of parameters, and the places of the tests."""

import ast
import inspect
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

import gpmodel

ROOT = Path(__file__).parents[1]
PRODUCT = [p for package in ("gpmodel", "robots", "joints") for p in sorted((ROOT / package).rglob("*.py"))]
TESTS = sorted((ROOT / "tests").rglob("*.py"))
KERNELS = ROOT / "gpmodel" / "evolution" / "kernels"
LONGEST_FILE, LONGEST_FUNCTION, MOST_PARAMETERS = 400, 60, 6
HEART, HEART_LINES, HEART_FILES = ("discovery", "evidence", "selection"), 5100, 33
"""Folders that decide what is found, and their budget. A change may lower it; a rise has to be seen in a commit."""
PASSED_THROUGH = {"discovery/loop.py discover", "planning/simulate.py simulate"}
"""Functions that receive the keyword arguments of the public functions of these names."""
Function = ast.FunctionDef | ast.AsyncFunctionDef
Entry = tuple[Path, ast.ClassDef | None, Function]


def name_of(path: Path) -> str:
    return path.relative_to(ROOT / "gpmodel" if path.is_relative_to(ROOT / "gpmodel") else ROOT).as_posix()


@cache
def statements_of(path: Path) -> list[ast.AST]:
    """The statements of a file at any depth, read once for all tests."""
    pending: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
    for node in pending:
        for field in ("body", "orelse", "finalbody", "handlers", "cases"):
            pending += getattr(node, field, ())
    return pending


def functions(paths: list[Path]) -> Iterator[Entry]:
    """Every function and method outside the kernels, with its class."""
    for path in paths:
        owner = {f: c for c in statements_of(path) if isinstance(c, ast.ClassDef) for f in c.body}
        for node in statements_of(path):
            if isinstance(node, Function) and KERNELS not in path.parents:
                yield path, owner.get(node), node


def test_no_file_is_long() -> None:
    everything = (*PRODUCT, *TESTS, *(ROOT / "experiments").rglob("*.py"))
    files = [p for p in everything if KERNELS not in p.parents]
    long = {str(p.relative_to(ROOT)): n for p in files if (n := p.read_text().count("\n")) > LONGEST_FILE}
    assert long == {}


def test_the_heart_keeps_its_budget() -> None:
    files = [p for folder in HEART for p in (ROOT / "gpmodel" / folder).glob("*.py")]
    assert len(files) <= HEART_FILES
    assert sum(p.read_text(encoding="utf-8").count("\n") for p in files) <= HEART_LINES


@pytest.mark.parametrize("package", ["gpmodel", "robots", "joints", "tests", "experiments"])
def test_no_function_is_long(package: str) -> None:
    found = functions(sorted((ROOT / package).rglob("*.py")))
    long = {f"{p.name} {f.name}": n for p, _, f in found if (n := f.end_lineno - f.lineno + 1) > LONGEST_FUNCTION}
    assert long == {}


def test_no_function_has_many_parameters() -> None:
    public = {f"{Path(inspect.getfile(v)).relative_to(ROOT / 'gpmodel')} {n}" for n, v in public_functions().items()}
    many = {}
    for path, owner, f in functions(PRODUCT):
        arguments = (*f.args.posonlyargs, *f.args.args, *f.args.kwonlyargs)
        count = len(arguments) - (owner is not None)
        commands = any(".command(" in ast.unparse(d) for d in f.decorator_list)
        name = f"{name_of(path)} {f.name}"
        if count > MOST_PARAMETERS and name not in public | PASSED_THROUGH and not commands:
            many[name] = count
    assert many == {}


def public_functions() -> dict[str, object]:
    values = {name: getattr(gpmodel, name) for name in gpmodel.__all__}
    return {name: value for name, value in values.items() if inspect.isfunction(value)}


def test_the_command_line_is_the_last_layer() -> None:
    users = [p for p in PRODUCT if re.search(r"(from|import) gpmodel\.cli\b", p.read_text(encoding="utf-8"))]
    outside = [
        str(p.relative_to(ROOT)) for p in users if "cli" not in p.parts and p.name not in ("cli.py", "__main__.py")
    ]
    assert outside == []


def test_tests_lie_as_the_packages_do() -> None:
    packages = {p.name for p in (ROOT / "gpmodel").iterdir() if p.is_dir()} | {"robots", "joints", "experiments"}
    folders = {p.parent.name for p in TESTS if p.parent != ROOT / "tests"}
    assert folders <= packages
    wanted = {p for p in packages if list((ROOT / "gpmodel" / p).glob("[!_]*.py"))} - {"testing"}
    assert wanted <= folders


def test_no_test_is_imported_from() -> None:
    assert [p.name for p in TESTS if re.search(r"^\s*(from|import) test_", p.read_text(encoding="utf-8"), re.M)] == []
    assert all(p.name.startswith("test_") for p in TESTS if p.parent != ROOT / "tests")


def test_every_public_name_is_there() -> None:
    assert all(hasattr(import_module("gpmodel"), name) for name in gpmodel.__all__)


FROM_TEXT = {
    "checks/judge.py",
    "cli/discover.py",
    "cli/poses.py",
    "cli/request.py",
    "records/unfinished.py",
    "texts.py",
    "joints/studies/contact.py",
    "joints/passive_joint.py",
    "joints/settings.py",
    "table/units.py",
}
"""Where text of JSON or TOML becomes values; nowhere else is anything of any type."""


def test_nothing_is_of_any_type_but_what_is_read_of_text() -> None:
    texts = {p: text for p in PRODUCT if "Any" in (text := p.read_text(encoding="utf-8"))}
    names = {p: {n.id for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Name)} for p, text in texts.items()}
    assert {name_of(p) for p in texts if "Any" in names[p]} <= FROM_TEXT


def test_a_name_is_of_one_thing() -> None:
    modules = [statements_of(p)[0] for p in (ROOT / "gpmodel").rglob("*.py")]
    classes = [node.name for module in modules for node in module.body if isinstance(node, ast.ClassDef)]
    assert sorted({name for name in classes if classes.count(name) > 1}) == []
