"""The time plots without a browser: their moments, their numbers, and the sentences around them."""

from __future__ import annotations

import base64
from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.workbench.run_view import load_run_view
from aircraft_sysid_ros.workbench.views import coefficients, figure, words


@pytest.fixture(scope="module")
def view(hidden_effect):
    """The run as the page holds it."""
    return load_run_view(hidden_effect)


def numbers(coded: dict) -> np.ndarray:
    return np.frombuffer(base64.b64decode(coded["bdata"]), "<f4")


@pytest.mark.parametrize("reach", [0.0048, 0.00101, 0.0099, 0.0021, 7.0])
def test_the_axis_of_a_residual_has_a_number_beside_zero(reach) -> None:
    ticks = figure.ticks_about_zero(np.array([np.nan, -0.3 * reach, reach]), np.array([0.1 * reach]))
    assert 1 <= reach // ticks["dtick"] <= 2
    assert figure.ticks_about_zero(np.full(3, np.nan), np.zeros(2)) == {}


def test_a_sentence_begins_with_a_capital_but_a_path_stays_what_it_is() -> None:
    assert words.sentence("added: C_m") == "Added: C_m" and words.sentence("C_m is") == "C_m is"
    assert words.sentence("runs/monday is no run") == "runs/monday is no run"
    assert words.sentence("state.json is not there") == "state.json is not there"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("C_m and CZ, C_m,q: 9% of -14.4", "C<sub>m</sub> and C<sub>Z</sub>, C<sub>m,q</sub>: 9 % of −14.4"),
        ("Cm_de is HOLD; a 3-2-1-1", '<span class="mono">Cm_de</span> is HOLD; a 3-2-1-1'),
        ("`aircraft-sysid add` <b>", '<span class="mono">aircraft-sysid add</span> &lt;b&gt;'),
        ("10^6 times, f-2, 1-3 s, 5 %, T_c", "10⁶ times, f-2, 1-3 s, 5 %, T<sub>c</sub>"),
        ("try '-0.3*alpha - CX', not -2", "try &#39;-0.3*alpha - CX&#39;, not −2"),
        ("under 'model' CX: [1, alpha] has it", "under &#39;model&#39; CX: [1, alpha] has it"),
    ],
)
def test_a_sentence_has_the_symbols_of_the_page(text, shown) -> None:
    assert words.typeset(text) == shown


def test_a_difference_that_rounds_to_nothing_has_no_sign() -> None:
    assert words.rounded(-0.00032, 0.021) == ("0.000", "0.021") and words.rounded(-0.3, 0.021)[0] == "−0.300"


@pytest.mark.long
def test_a_worse_version_beside_has_the_same_moments_and_few_numbers(view) -> None:
    found = view.comparison.axes["CX"]
    worse = replace(found, fit=replace(found.fit, held_out=60.0 * found.fit.held_out))
    beside = replace(view.comparison, axes={**view.comparison.axes, "CX": worse})
    made = coefficients.coefficient_figure(view.comparison, "CX", figure.LIGHT, beside=beside)
    drawn = {trace["name"]: trace for trace in made["data"]}
    times = [numbers(drawn[name]["x"]) for name in ("measured", "predicted", "the other version")]
    assert all(np.array_equal(times[0], other) for other in times[1:])
    other = np.nanmax(np.abs(numbers(drawn["residual, the other version"]["y"])))
    assert other // made["layout"]["yaxis2"]["dtick"] <= 2  # numbers of both, not of the better one
