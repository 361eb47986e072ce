"""Builds the wheel, in which `robots` and `joints` are called `gpmodel_robots` and `gpmodel_joints`: other people have
packages of those names. A checkout and an editable installation keep the names `robots` and `joints`."""

import re
import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

INSTALLED = {name: f"gpmodel_{name}" for name in ("robots", "joints")}
IMPORT = re.compile(rf"^(\s*(?:from|import) )({'|'.join(INSTALLED)})(?=[. ])", re.MULTILINE)
ENTRY_POINT = re.compile(rf"(= )({'|'.join(INSTALLED)})(?=[.:])")


def renamed(pattern: re.Pattern[str], text: str) -> str:
    """Replace the names of the packages `robots` and `joints` in a text by their installed names."""
    return pattern.sub(lambda found: found[1] + INSTALLED[found[2]], text)


class BuildPy(build_py):
    """Build the packages, of which `robots` and `joints` get their installed names."""

    def run(self) -> None:
        """Build as setuptools does, then rename folders and imports."""
        super().run()
        if self.editable_mode:
            return
        for name, installed in INSTALLED.items():
            folder = Path(self.build_lib) / installed
            shutil.rmtree(folder, ignore_errors=True)
            shutil.move(Path(self.build_lib) / name, folder)
            for file in folder.rglob("*.py"):
                file.write_text(renamed(IMPORT, file.read_text(encoding="utf-8")), encoding="utf-8")


class BdistWheel(bdist_wheel):
    """Write the wheel, with entry points that refer to the installed names of the packages."""

    built = False

    def run(self) -> None:
        """Run the build of a wheel (not called for an editable installation, whose entry points stay)."""
        self.built = True
        super().run()

    def write_wheelfile(self, wheelfile_base: str, *arguments: str, **named: str) -> None:
        """Write the wheel's metadata as setuptools does, after the entry points are renamed."""
        if self.built:
            for name in ("entry_points.txt", "top_level.txt"):
                file = Path(wheelfile_base) / name
                text = renamed(ENTRY_POINT, file.read_text(encoding="utf-8"))
                file.write_text("\n".join(INSTALLED.get(line, line) for line in text.splitlines()) + "\n", "utf-8")
        super().write_wheelfile(wheelfile_base, *arguments, **named)


setup(cmdclass={"build_py": BuildPy, "bdist_wheel": BdistWheel})
