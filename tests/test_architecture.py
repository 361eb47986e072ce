"""Which way imports point, read from the source."""

import ast
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = [p for package in ("gpmodel", "robots", "joints") for p in sorted((ROOT / package).rglob("*.py"))]
DRAWING = {"plots.py", "picture.py", "figures.py"}
FENCED = {
    "pinocchio": lambda path: path.parent.name == "robots",
    "example_robot_data": lambda path: path.parent.name == "robots",
    "deap": lambda path: path == ROOT / "gpmodel" / "tree.py",
    "numba": lambda path: path.parent == ROOT / "gpmodel" / "kernels",
    "matplotlib": lambda path: path.name in DRAWING or path.name.startswith("charts"),
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


def test_every_dependency_imported_is_declared() -> None:
    declared = (ROOT / "pyproject.toml").read_text().lower().replace("-", "_")
    spelled = {"pinocchio": '"pin>', "PIL": "pillow"}
    own = {"gpmodel", "robots", "joints"}
    for name in {n for p in FILES for n in packages(p)} - set(sys.stdlib_module_names) - own:
        assert spelled.get(name, name.lower()) in declared, name


def test_loading_the_loop_and_the_robots_opens_no_gui_and_no_plots() -> None:
    code = (
        "import sys, gpmodel.discover_command, robots, joints\n"
        "bad = {'matplotlib.pyplot', 'tkinter', 'PyQt5', 'PyQt6', 'PySide6', 'wx', 'gi', 'meshcat', 'IPython'}\n"
        "print(sorted(bad & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_calibration_runs_on_one_blas_thread_whatever_the_machine_says() -> None:
    code = (
        "import gpmodel.calibration as c, threadpoolctl\n"
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
