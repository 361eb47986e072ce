"""Finished runs of genetic programming, on disk at once; going on from them gives the same numbers."""

from dataclasses import dataclass

from gpmodel.evolution.runs import KeptRuns, Number
from gpmodel.evolution.search import Evolution
from gpmodel.evolution.settings import Settings
from gpmodel.records.unfinished import Unfinished


@dataclass(frozen=True)
class RunFiles(KeptRuns):
    """A file each run."""

    files: Unfinished

    def run(self, number: Number) -> Evolution | None:
        """Read a finished run, without its settings."""
        content = self.files.read(_run(number))
        if content is None:
            return None
        front, best = content["front"], content["best"]
        counts = best.program.input_counts, best.program.operator_counts
        return Evolution(
            front, best, content["history"], *counts, content["evaluations"], content["seconds"], Settings()
        )

    def keep_run(self, number: Number, found: Evolution) -> None:
        """Write what is needed of a run."""
        names = ("front", "best", "history", "evaluations", "seconds")
        self.files.write(_run(number), {name: getattr(found, name) for name in names})


def _run(number: Number) -> str:
    return f"run-{number[0]}-{number[1]:04d}"
