"""Measure packages, bytes and seconds of a minimal installation.

    python -m experiments.speed.lean

makes a fresh environment, installs this package without extras into it, and writes lean.json.
"""

import json
import shutil
import subprocess
import sys
import tempfile
import tomllib
import venv
from pathlib import Path

import gpmodel as gp

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
TABLE = ROOT / "gpmodel" / "data" / "demo.csv"
REPEATS = 9
TIMED = """
import pathlib, time
before, cpu = time.perf_counter(), time.process_time()
{code}
after, spent = time.perf_counter() - before, time.process_time() - cpu
status = pathlib.Path("/proc/self/status").read_text()
print(after, spent, int(status.partition("VmHWM:")[2].split()[0]) / 1024)
"""
PREDICTS = "import gpmodel as gp\ngp.load_model({model!r}).predict({table!r})"


def megabytes(folder: Path, *, bytecode: bool) -> float:
    """Return the size of all files below a folder, without pip and setuptools."""
    own = ("pip", "setuptools", "pkg_resources", "_distutils_hack")
    files = (f for f in folder.rglob("*") if f.is_file() and not f.relative_to(folder).parts[0].startswith(own))
    return round(sum(f.stat().st_size for f in files if bytecode or f.suffix != ".pyc") / 1e6, 1)


def best(python: Path, code: str) -> dict[str, float]:
    """Least wall and CPU seconds and the memory, MB, of REPEATS fresh processes, of Linux."""
    runs = []
    for _ in range(REPEATS):
        done = subprocess.run(
            [python, "-I", "-c", TIMED.format(code=code)], capture_output=True, text=True, check=True
        )  # fmt: skip
        runs.append([float(text) for text in done.stdout.split()])
    wall, cpu, memory = (min(column) for column in zip(*runs, strict=True))
    return {"seconds": round(wall, 3), "cpu_seconds": round(cpu, 3), "memory_mb": round(memory)}


def main() -> None:
    """Measure, print and write lean.json."""
    dependencies = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    with tempfile.TemporaryDirectory() as place:
        venv.create(Path(place) / "env", with_pip=True)
        python = Path(place) / "env" / "bin" / "python"
        pip = [python, "-m", "pip", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*pip, "download", "--dest", f"{place}/wheels", *dependencies], check=True)
        for part in ("gpmodel", "robots", "joints"):
            shutil.copytree(ROOT / part, Path(place) / "source" / part, ignore=shutil.ignore_patterns("__pycache__"))
        for part in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
            shutil.copy(ROOT / part, Path(place) / "source")
        subprocess.run([*pip, "install", f"{place}/source"], check=True)
        packages = Path(place) / "env" / "lib" / f"python3.{sys.version_info[1]}" / "site-packages"
        model = f"{place}/model.json"
        gp.calibrate(gp.load_mechanism("irb6400r"), TABLE, ["joint_compliance J5"]).model.save(model)
        found = {
            "dependencies": len(dependencies),
            "packages with theirs": len(list(Path(place, "wheels").iterdir())),
            "download_mb": megabytes(Path(place) / "wheels", bytecode=True),
            "installed_mb": megabytes(packages, bytecode=False),
            "installed_with_bytecode_mb": megabytes(packages, bytecode=True),
            "import gpmodel": best(python, "import gpmodel"),
            "load_model(f).predict(table)": best(python, PREDICTS.format(model=model, table=str(TABLE))),
        }
    (HERE / "lean.json").write_text(json.dumps(found, indent=1) + "\n")
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
