"""Test that an installed package contains every file of the checkout."""

import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
INSTALLED = {"gpmodel": "gpmodel", "robots": "gpmodel_robots", "joints": "gpmodel_joints"}
"""Folder -> what it is called once installed; others have packages called robots and joints."""


@pytest.mark.long
def test_the_wheel_holds_every_file_of_the_packages_under_names_of_our_own(tmp_path: Path) -> None:
    source = tmp_path / "source"
    for package in INSTALLED:
        shutil.copytree(ROOT / package, source / package, ignore=shutil.ignore_patterns("__pycache__", "*.pyc"))
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    wanted = {
        f"{installed}/{p.relative_to(source / n).as_posix()}"
        for n, installed in INSTALLED.items()
        for p in (source / n).rglob("*")
        if p.is_file()
    }
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*build, "--wheel-dir", tmp_path, source], check=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as packed:
        held = {name for name in packed.namelist() if ".dist-info/" not in name}
        code = [packed.read(name).decode() for name in held if name.endswith(".py")]
        (points,) = [packed.read(name).decode() for name in packed.namelist() if name.endswith("entry_points.txt")]
    assert held == wanted
    assert not any(re.search(r"^\s*(from|import) (robots|joints)\b", text, re.MULTILINE) for text in code)
    assert "robots = gpmodel_robots:load_mechanism" in points
    assert "joint = gpmodel_joints.cli:joint" in points
