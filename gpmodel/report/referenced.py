"""The histogram of referenced inputs under the table's own names."""

from collections.abc import Mapping

from gpmodel.evolution.input_histogram import Histogram
from gpmodel.report.schema_search import HistogramRecord


def histogram_record(counted: Histogram, names: Mapping[str, str]) -> HistogramRecord:
    """What a report keeps of a histogram; `names` are the table's names of inputs."""
    return HistogramRecord(
        inputs=tuple(names.get(x, x) for x in counted.inputs),
        counts=dict(counted.counts),
        shuffled=counted.referring_by_chance(),
        p_values=counted.p_values,
        count_p=counted.count_p,
        strength_p=counted.strength_p,
        runs=sum(counted.runs.values()),
        shuffled_runs=sum(counted.shuffled_runs.values()),
        significance=counted.significance,
        significant=tuple(names.get(x, x) for x in counted.significant),
    )
