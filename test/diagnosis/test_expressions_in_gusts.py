"""Expressions outside the library: rates of the flow angles say nothing in gusts, which make them, nor of forces."""

from dataclasses import replace

from aircraft_sysid_ros.aircraft.expression import parse_expression
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run
from aircraft_sysid_ros.diagnosis.search.evaluator import expressions
from aircraft_sysid_ros.effects.effect import with_setting

RATES = {"alpha_dot", "beta_dot"}


def axes_with_rates(flight) -> set[str]:
    return {
        axis
        for candidate in expressions(flight)
        for axis, texts in candidate.terms.items()
        if any(parse_expression(text).signals & RATES for text in texts)
    }


def test_in_gusts_nothing_is_explained_by_the_rate_of_an_angle(hidden_run) -> None:
    flight = open_run(hidden_run).flight()
    calm = with_setting(flight.aircraft, ("process_noise", "wind"), 0.02)
    gusty = with_setting(flight.aircraft, ("process_noise", "wind"), 1.0)
    assert axes_with_rates(replace(flight, aircraft=calm)) == {"Cl", "Cm", "Cn"}  # they are made of the forces
    assert axes_with_rates(replace(flight, aircraft=gusty)) == set()
