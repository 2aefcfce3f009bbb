"""The page and the picture of a check say what the command says, and leave nothing out silently."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.flight_check.check import SHORTEST, nothing_wrong
from aircraft_sysid_ros.flight_check.finding import INFO, WARNING, Finding
from aircraft_sysid_ros.report import check_figure
from aircraft_sysid_ros.report.check_page import check_page
from aircraft_sysid_ros.report.pyplot import pyplot

ABSENT = Finding(("angle_of_attack",), "missing", INFO, "not in the recording")


def checked(duration: float, findings: tuple[Finding, ...] = (), rates: dict[str, float] | None = None):
    motion = SimpleNamespace(flight=SimpleNamespace(duration=duration))
    return SimpleNamespace(findings=findings, rates=rates or {}, parameters=(), motion=motion)


def written(found) -> list[str]:
    """What stands in the part of the picture that lists findings."""
    plt = pyplot()
    figure, plot = plt.subplots()
    check_figure._findings(plot, found)
    plt.close(figure)
    return [text.get_text() for text in plot.texts]


@pytest.mark.parametrize("findings", [(), (ABSENT,)])
@pytest.mark.parametrize("duration", [0.5 * SHORTEST, 10.0 * SHORTEST])
def test_of_a_recording_that_is_too_short_nothing_is_said_to_be_right(duration, findings) -> None:
    """The page of a recording of 2 s said that nothing contradicts itself."""
    said = nothing_wrong(duration)
    page = check_page(checked(duration, findings), b"", "flight").lower()
    assert said in page and (nothing_wrong(100.0) in page) == (duration > SHORTEST)
    assert said in written(checked(duration, findings))


def test_a_signal_of_one_sample_has_no_rate() -> None:
    page = check_page(checked(60.0, (), {"height_above_ground": np.nan}), b"", "flight")
    assert "<td>one sample</td>" in page and "nan" not in page


@pytest.mark.parametrize("count", [1, 5, 9, 30])
def test_findings_that_do_not_fit_into_the_picture_are_counted(count) -> None:
    """Sentences of some lines each left no room for all of nine, and nothing said so."""
    findings = tuple(Finding((f"s{i}",), "scale", WARNING, f"number {i} " + 40 * "of words ") for i in range(count))
    texts = written(checked(60.0, findings))
    shown = [text for text in texts if text.startswith(WARNING)]
    rest = [int(found[1]) for text in texts if (found := re.match(r"and (\d+) more", text))]
    assert len(shown) + sum(rest) == count and (len(rest) == 1) == (len(shown) < count)
