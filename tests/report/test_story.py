"""Histogram and findings tell one story, also where they name different inputs."""

from dataclasses import replace

from report_runs import discovered

from gpmodel.evolution.input_histogram import Histogram
from gpmodel.report.schema import Report
from gpmodel.report.words import story


def told(*significant: tuple[str, ...], inputs: tuple[str, ...] = ("moment_base_x",), found: bool = True) -> list[str]:
    report: Report = discovered()
    effects = (replace(report.effects[0], name="base compliance", inputs=inputs, round=1),) if found else ()
    histograms = tuple(
        Histogram(names, {}, {}, {}, {}, {}, (0.0,) * len(names), (0.0,) * len(names), 0.05) for names in significant
    )
    return list(story(replace(report, effects=effects, histograms=histograms)))


def test_what_agrees_needs_no_word() -> None:
    assert told(("moment_base_x",), ()) == []
    assert told((), ()) == []


def test_a_lead_that_led_elsewhere_is_explained() -> None:
    (said,) = told(("torque_J2",), ())
    assert said == (
        "The programs used torque_J2 as a proxy; base compliance explains the same error better; "
        "with that in the model nothing refers to it any more."
    )
    (still,) = told(("torque_J2",), ("torque_J2",))[:1]
    assert "any more" not in still


def test_a_lead_without_a_finding_is_called_one() -> None:
    assert told(("temperature",), found=False) == [
        "temperature is significant, but no law of it passed the tests: a lead, not a finding."
    ]
