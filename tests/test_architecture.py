"""Test the direction of imports between packages, read from the source."""

import ast
import os
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest

import gpmodel
from gpmodel.cli.main import COMMANDS
from gpmodel.extras import EXTRAS

ROOT = Path(__file__).parents[1]
FILES = [p for package in ("gpmodel", "robots", "joints") for p in sorted((ROOT / package).rglob("*.py"))]
FENCED = {
    "pinocchio": lambda path: path.parent.name == "robots",
    "coal": lambda path: path.parent.name == "robots",
    "example_robot_data": lambda path: path.parent.name == "robots",
    "deap": lambda path: path.name in ("tree_breeding.py", "search.py"),
    "numba": lambda path: path.parent == ROOT / "gpmodel" / "evolution" / "kernels",
    "matplotlib": lambda path: "report" in path.parts or "joints" in path.parts,
    "jinja2": lambda path: "report" in path.parts or "joints" in path.parts,
}


@cache
def imports(path: Path) -> frozenset[str]:
    """Full dotted names of everything a file imports anywhere in it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(found)


def packages(path: Path) -> set[str]:
    return {name.split(".")[0] for name in imports(path)}


@pytest.mark.parametrize("path", FILES, ids=lambda p: f"{p.parent.name}/{p.name}")
def test_imports_point_one_way_and_dependencies_stay_in_their_files(path: Path) -> None:
    assert not packages(path) & {"experiments", "tests"}
    if path.is_relative_to(ROOT / "gpmodel"):
        assert not packages(path) & {"robots", "joints"}
    if path.is_relative_to(ROOT / "robots"):
        assert "joints" not in packages(path)
    for dependency, allowed in FENCED.items():
        assert dependency not in packages(path) or allowed(path), f"{dependency} in {path}"
    assert not any(name.startswith(("matplotlib.pyplot", "pylab", "tkinter", "PyQt")) for name in imports(path))
    assert not imports(path) & {"numpy.random.seed", "numpy.random.rand", "matplotlib.use"}


def test_the_fences_have_something_inside() -> None:
    users = {name: [p for p in FILES if name in packages(p)] for name in FENCED}
    assert all(users.values())


def test_the_base_installation_has_at_most_eight_dependencies_and_each_extra_what_it_is_said_to_bring() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert len(project["dependencies"]) <= 8
    spelled = {"pinocchio": "pin", "example_robot_data": "example-robot-data", "llvmlite": "numba"}
    for extra, modules in EXTRAS.items():
        brought = " ".join(project["optional-dependencies"][extra])
        if "gpmodel[report]" in brought:
            brought += " ".join(project["optional-dependencies"]["report"])
        assert all(spelled.get(module, module) in brought for module in modules), extra


def test_every_dependency_imported_is_declared() -> None:
    declared = (ROOT / "pyproject.toml").read_text().lower().replace("-", "_")
    spelled = {"pinocchio": '"pin>', "PIL": "pillow"}
    own = {"gpmodel", "robots", "joints"}
    for name in {n for p in FILES for n in packages(p)} - set(sys.stdlib_module_names) - own:
        assert spelled.get(name, name.lower()) in declared, name


def test_loading_the_loop_and_the_robots_opens_no_gui_and_no_plots() -> None:
    code = (
        "import sys, gpmodel.cli.discover, robots, joints\n"
        "bad = {'matplotlib.pyplot', 'tkinter', 'PyQt5', 'PyQt6', 'PySide6', 'wx', 'gi', 'meshcat', 'IPython'}\n"
        "print(sorted(bad & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_calibration_runs_on_one_blas_thread_whatever_the_machine_says() -> None:
    code = (
        "import gpmodel.calibration.gauss_newton as c, threadpoolctl\n"
        "seen = []\n"
        "def spy(*a):\n"
        "    seen.extend(p['num_threads'] for p in threadpoolctl.threadpool_info() if p['user_api'] == 'blas')\n"
        "c._calibrate = spy\n"
        "c.calibrate(None, None)\n"
        "print(sorted(set(seen)))"
    )
    many = os.environ | {"OPENBLAS_NUM_THREADS": "4", "OMP_NUM_THREADS": "4"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=many)
    assert done.stdout.strip() == "[1]"


ORDER = (
    "_version", "characters", "errors", "extras", "wording", "arrays", "files", "texts", "executor", "cluster",
    "progress", "numerics", "formula", "mechanism", "table", "model", "evolution", "families", "calibration", "checks",
    "planning", "evidence", "selection", "discovery", "records", "application", "hierarchy", "report", "api", "cli",
)  # fmt: skip
ALONE = {"evolution", "formula", "files", "errors", "arrays", "executor"}


def modules() -> dict[str, Path]:
    return {name: path for name, path in all_modules().items() if path.is_relative_to(ROOT / "gpmodel")}


def all_modules() -> dict[str, Path]:
    return {".".join(p.relative_to(ROOT).with_suffix("").parts): p for p in FILES}


def edges(known: dict[str, Path] | None = None) -> dict[str, set[str]]:
    """Module -> modules that it imports, those of gpmodel where none are given, by their full names."""
    known = known or modules()
    found = {}
    for name, path in known.items():
        wanted = imports(path)
        found[name] = {m for m in known if any(w == m or w.startswith(f"{m}.") for w in wanted)} - {name}
    return found


def package(module: str) -> str:
    return module.split(".")[1] if module != "gpmodel.__init__" else "__init__"


def test_every_package_of_the_core_has_its_place() -> None:
    assert {package(m) for m in modules()} - {"__init__", "__main__", "testing"} == set(ORDER)


def test_packages_import_only_what_stands_above_them() -> None:
    upward = [
        f"{a} imports {b}"
        for a, others in edges().items()
        for b in others
        if package(a) in ORDER and (package(b) not in ORDER or ORDER.index(package(b)) > ORDER.index(package(a)))
    ]
    assert upward == []


def test_the_engine_of_genetic_programming_stands_alone() -> None:
    foreign = {f"{a} imports {b}" for a, o in edges().items() for b in o if package(a) == "evolution"}
    assert {e for e in foreign if package(e.split()[-1]) not in ALONE} == set()


def test_no_file_imports_itself_by_way_of_others() -> None:
    graph = {a: others for a, others in edges(all_modules()).items() if not a.endswith("__init__")}
    waiting = dict(graph)
    while ready := [a for a, others in waiting.items() if not others & set(waiting)]:
        for a in ready:
            del waiting[a]
    assert waiting == {}


def reachable(graph: dict[str, set[str]], start: set[str]) -> set[str]:
    """Modules that some import, directly or by others; the packages they are in, too."""
    found: set[str] = set()
    waiting = set(start)
    while waiting:
        name = waiting.pop()
        found.add(name)
        around = {".".join([*name.split(".")[:k], "__init__"]) for k in range(1, name.count(".") + 1)}
        waiting |= ((graph.get(name, set()) | around) & set(graph)) - found
    return found


def test_a_public_name_or_a_command_reaches_every_module() -> None:
    graph = edges(all_modules())
    commands = {f"gpmodel.cli.{home.split(':')[0]}" for home, _ in COMMANDS.values()} | {"gpmodel.cli.main"}
    plugins = {"robots.__init__", "joints.__init__", "joints.cli", "gpmodel.testing.__init__", "gpmodel.__main__"}
    data = {"robots.data.__init__"}
    public = {f"gpmodel.{home}" for home in gpmodel._HOME.values()}
    assert public | plugins | commands <= set(graph)
    assert set(graph) - reachable(graph, commands | plugins | public) == data
