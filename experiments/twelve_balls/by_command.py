"""Search hexapods with one ball out of round by the command `gpmodel discover`.

From the root of the repository:
python -m experiments.twelve_balls.by_command [--machines 20] [--first 931] [--out FOLDER]
"""

import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from experiments.options import parsed
from experiments.twelve_balls.run import HERE, POSES
from experiments.twelve_balls.simulator import BALLS, MACHINES, table
from gpmodel.report.origin import versions


def one_machine(seed: int, folder: Path) -> dict[str, Any]:
    """Exit status, verdict, processor seconds, and whether the bad ball and nothing else is named."""
    text, fault = table("hexapod", seed, True, POSES["hexapod"])
    measured, out = folder / f"{seed}.csv", folder / f"{seed}"
    measured.write_text(text, encoding="utf-8")
    words = ["discover", measured, "--mechanism", MACHINES["hexapod"][0], "--runs", "0", "--workers", "1", "--out", out]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, "-m", "gpmodel", *map(str, words)], capture_output=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    saved = out / "report.json"
    report = json.loads(saved.read_text(encoding="utf-8")) if saved.exists() else {"effects": [], "verdict": None}
    ball = BALLS[fault.ball].replace(".", "_")
    of_ball = [all(name.startswith(ball) for name in effect["inputs"]) for effect in report["effects"]]
    return {
        "seed": seed, "status": done.returncode, "report": (out / "report.html").exists(), "truth": fault.angle,
        "right": bool(of_ball) and all(of_ball), "named": [effect["name"] for effect in report["effects"]],
        "verdict": report["verdict"], "seconds": round(after.ru_utime - before.ru_utime, 1),
    }  # fmt: skip


def main(arguments: list[str] | None = None) -> None:
    """Run all machines and write hexapod_by_command.json after each."""
    chosen = parsed(__doc__, arguments, machines=20, first=931, out=HERE)
    done: list[dict[str, Any]] = []
    for seed in range(chosen.first, chosen.first + chosen.machines):
        with tempfile.TemporaryDirectory() as folder:
            done.append(one_machine(seed, Path(folder)))
        print(done[-1], flush=True)
        results = {
            "command": f"python -m experiments.twelve_balls.by_command --machines {len(done)} --first {chosen.first}",
            "versions": versions(),
            "ended in a report": f"{sum(m['report'] and not m['status'] for m in done)} of {len(done)}",
            "the bad ball is named, and nothing else": f"{sum(m['right'] for m in done)} of {len(done)}",
            "machines": done,
        }  # fmt: skip
        text = json.dumps(results, indent=1, ensure_ascii=False)
        (chosen.out / "hexapod_by_command.json").write_text(f"{text}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
