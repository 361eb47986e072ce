"""Finished parts of a discovery on disk; resuming from them reproduces the numbers."""

from collections.abc import Sequence
from dataclasses import dataclass

from gpmodel.discovery.state import Finding, Journal, Round
from gpmodel.evolution.runs import Number
from gpmodel.evolution.search import Evolution
from gpmodel.evolution.settings import Settings
from gpmodel.records.unfinished import Unfinished


@dataclass(frozen=True)
class JournalFiles(Journal):
    """A journal in files, one each round and each run."""

    files: Unfinished

    def begin(self) -> tuple[list[Finding], list[Round]]:
        """Findings and rounds that are finished."""
        findings: list[Finding] = []
        rounds: list[Round] = []
        while (content := self.files.read(f"round-{len(rounds) + 1}")) is not None:
            findings = content["findings"]
            rounds.append(content["round"])
        return findings, rounds

    def keep(self, findings: Sequence[Finding], rounds: Sequence[Round]) -> None:
        """Write the last round; the runs it was made of are no longer needed."""
        number = rounds[-1].number
        self.files.write(f"round-{number}", {"findings": list(findings), "round": rounds[-1]})
        self.files.forget(f"run-{number}-*")

    def run(self, number: Number) -> Evolution | None:
        """A finished run, without its settings."""
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
