"""Executors whose workers run in other processes or lose their tasks."""

import pickle
from collections.abc import Callable, Iterator, Sequence
from typing import Any


class Elsewhere:
    """Takes copies of the tasks, the last first, and loses the first result; `functions`: what it was given to run."""

    def __init__(self) -> None:
        self.functions: set[str] = set()

    def __call__(self, function: Callable[[Any], Any], tasks: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
        sent = [pickle.dumps((function, task)) for task in tasks]
        for place in reversed(range(len(sent))):
            self.functions.add(function.__name__)
            for _ in range(2 if place == 0 else 1):
                run, task = pickle.loads(sent[place])
                found = run(task)
            yield place, pickle.loads(pickle.dumps(found))
