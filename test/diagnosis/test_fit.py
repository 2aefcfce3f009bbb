"""The fit of one axis: against plain least squares, fold by fold; honest errors; columns that say nothing."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX, SIGNALS
from aircraft_sysid_ros.diagnosis.flight.flight_data import BLOCK, FOLDS, FlightData
from aircraft_sysid_ros.diagnosis.search.fit import AxisFit, fit_axis
from aircraft_sysid_ros.errors import InputError

STEP = 0.04


def flight_of(aircraft, seconds: float = 120.0, seed: int = 0, noise: float = 0.01) -> FlightData:
    """Random motion, with C_Z a known function of it and noise."""
    random = np.random.default_rng(seed)
    n = round(seconds / STEP)
    signals = np.full((n, len(SIGNALS)), np.nan)
    for name, size in {"alpha": 0.05, "beta": 0.05, "p": 0.02, "q": 0.004, "r": 0.02, "de": 0.1}.items():
        signals[:, SIGNAL_INDEX[name]] = size * random.normal(size=n)
    signals[:, SIGNAL_INDEX["V"]], signals[:, SIGNAL_INDEX["qbar"]] = 17.0, 177.0
    measured = np.full((n, 6), np.nan)
    terms = [signals[:, SIGNAL_INDEX[name]] for name in ("alpha", "q", "de")]
    measured[:, AXES.index("CZ")] = -0.3 - 4.6 * terms[0] - 3.0 * terms[1] - 0.1 * terms[2]
    measured += noise * random.normal(size=measured.shape)
    return FlightData(aircraft, STEP * np.arange(n), measured, signals, STEP)


def plain_held_out(flight: FlightData, columns: np.ndarray, axis: str) -> np.ndarray:
    """Held-out residuals (n,) by numpy's least squares, fold by fold; NaN at the borders of blocks."""
    y, out = flight.measured[:, AXES.index(axis)], np.full(len(flight.time), np.nan)
    use = ~flight.guarded & np.isfinite(y) & np.isfinite(columns).all(axis=1)
    for fold in range(FOLDS):
        inside = use & (flight.block % FOLDS == fold)
        theta, *_ = np.linalg.lstsq(columns[use & ~inside], y[use & ~inside], rcond=None)
        out[inside] = y[inside] - columns[inside] @ theta
    return out


def test_held_out_residuals_are_those_of_plain_least_squares(aircraft) -> None:
    flight = flight_of(aircraft)
    fit = fit_axis(flight, "CZ")
    expected = plain_held_out(flight, fit.columns, "CZ")
    assert np.allclose(fit.fit.held_out, expected, rtol=0.0, atol=1e-12, equal_nan=True)
    used = np.isfinite(expected)
    sums = [np.sum(expected[used & (flight.block == b)] ** 2) for b in fit.blocks]
    assert np.allclose(fit.held_out_sse, sums)
    spread = np.std(flight.measured[used, AXES.index("CZ")])
    assert fit.nrmse_held_out == pytest.approx(np.sqrt(np.mean(expected[used] ** 2)) / spread)


def test_parameters_and_the_borders_of_blocks(aircraft) -> None:
    flight = flight_of(aircraft, noise=0.0)
    assert fit_axis(flight, "CZ").fit.parameters == pytest.approx([-0.3, -4.6, -3.0, -0.1])
    held_out = fit_axis(flight, "CZ").fit.held_out
    distance = np.minimum(flight.time % BLOCK, BLOCK - flight.time % BLOCK)
    assert np.isnan(held_out[distance < 0.19]).all() and np.isfinite(held_out[distance > 0.21]).all()


@pytest.mark.parametrize("scale", [1.0, 1e-8, 1e8])
def test_gain_of_columns_is_that_of_a_new_fit(aircraft, scale: float) -> None:
    """Also where a column is of another size, and nearly explained by the base."""
    flight = flight_of(aircraft)
    alpha, beta = flight.signal("alpha"), flight.signal("beta")
    extra = scale * np.column_stack([alpha**3, alpha + 1e-3 * beta])
    base = fit_axis(flight, "CZ")
    gain, whole = base.gain(extra), base.extended(extra, ["a", "b"])
    expected = plain_held_out(flight, whole.columns, "CZ")
    assert np.allclose(gain.after, whole.held_out_sse, rtol=1e-6)
    assert np.nansum(expected**2) == pytest.approx(np.sum(gain.after), rel=1e-6)
    assert np.allclose(gain.parameters, whole.fit.parameters[-2:], rtol=1e-5)
    assert gain.nrmse_before == base.nrmse_held_out and gain.nrmse_after == pytest.approx(whole.nrmse_held_out)


def test_gain_where_a_column_has_gaps(aircraft) -> None:
    flight = flight_of(aircraft)
    extra = flight.signal("beta")[:, None].copy()
    extra[flight.time > 60.0] = np.nan
    gain = fit_axis(flight, "CZ").gain(extra)
    assert gain.count.sum() < 0.55 * len(flight.time)
    assert gain.before.shape == gain.after.shape == gain.count.shape
    assert not gain.fit.rows[flight.time > 60.0].any()


def test_what_the_flight_does_not_determine_is_named_and_harmless(aircraft) -> None:
    flight = flight_of(aircraft)
    base = fit_axis(flight, "CZ")
    twice = base.extended(2.0 * flight.signal("de")[:, None], ["CZ_twice"])
    assert twice.fit.not_determined == ("CZ_de", "CZ_twice")
    assert np.isnan(twice.fit.parameters[[3, 4]]).all() and twice.fit.parameters[1] == pytest.approx(-4.6, rel=0.01)
    assert np.isnan(twice.fit.std[[3, 4]]).all() and np.isfinite(twice.fit.std[:3]).all()
    assert twice.nrmse_held_out == pytest.approx(base.nrmse_held_out)
    still = base.gain(np.zeros((len(flight.time), 1)))
    assert np.isnan(still.parameters[0]) and np.allclose(still.after, still.before)


def changed(flight, more):
    """The flight with something more (n, 1) in its measured C_Z."""
    measured = flight.measured.copy()
    measured[:, 2] += more[:, 0]
    return replace(flight, measured=measured)


def test_an_event_in_one_fold_only_is_predicted_without(aircraft) -> None:
    """A column that is zero outside one block cannot be learnt from the others: it must not blow up."""
    flight = flight_of(aircraft)
    column = np.where(flight.block == 3, 1.0, 0.0)[:, None]
    gain = fit_axis(flight, "CZ").gain(column)
    assert np.allclose(gain.after, gain.before, rtol=0.05)


def test_what_only_one_fold_holds_explains_nothing_held_out(aircraft) -> None:
    """The same with something in that block to explain: the parameter from all points must not predict it."""
    flight = flight_of(aircraft)
    column = np.where(flight.block == 3, 1.0, 0.0)[:, None]
    gain = fit_axis(changed(flight, 0.3 * column), "CZ").gain(column)
    assert gain.fitted_after < 0.1 * gain.fitted_before
    assert np.sum(gain.after) > 0.9 * np.sum(gain.before)


def test_terms_that_are_measured_in_one_fold_only_are_refused_for_that(aircraft) -> None:
    """As thrust in one manoeuvre of three: hundreds of points are not too few of them."""
    flight = flight_of(aircraft)
    columns = np.where(flight.block % FOLDS == 1, 1.0, np.nan)[:, None] * np.ones((1, 2))
    with pytest.raises(InputError, match="measured together in one part of the flight only"):
        AxisFit(flight, "CZ", columns)


def test_standard_errors_hold_in_coloured_noise(aircraft) -> None:
    """100 flights with slow noise in response and regressor: within 1.96 sigma 95 % of the times, white ones fail."""
    random, z, z_white = np.random.default_rng(0), [], []
    for seed in range(100):
        flight = flight_of(aircraft, 60.0, seed)
        n = len(flight.time)
        slow = np.apply_along_axis(lambda v: np.convolve(v, np.ones(20) / 20, "same"), 0, random.normal(size=(n, 2)))
        columns = np.column_stack([np.ones(n), slow[:, 0]])
        fit = AxisFit(flight, "CZ", columns, measured=0.5 * slow[:, 0] + slow[:, 1])
        error = fit.fit.parameters[1] - 0.5
        z.append(error / fit.fit.std[1])
        white = np.nanstd(fit.fit.residual) / np.sqrt(np.sum((slow[fit.rows, 0] - slow[fit.rows, 0].mean()) ** 2))
        z_white.append(error / white)
    assert 0.86 <= np.mean(np.abs(z) < 1.96) <= 1.0  # the lag window loses some
    assert np.mean(np.abs(z_white) < 1.96) < 0.7


def test_covariance_is_symmetric_and_positive(aircraft) -> None:
    covariance = fit_axis(flight_of(aircraft), "CZ").fit.covariance
    assert np.allclose(covariance, covariance.T) and np.linalg.eigvalsh(covariance).min() > 0.0


def test_an_axis_without_data_says_why(aircraft) -> None:
    flight = flight_of(aircraft)
    flight.measured[:, AXES.index("Cl")] = 0.0
    with pytest.raises(
        InputError, match="Cl cannot be fitted: it needs da and dr, which are not measured: record them"
    ):
        fit_axis(flight, "Cl")
    flight.measured[:, AXES.index("CZ")] = np.nan
    with pytest.raises(InputError, match="not measured"):
        fit_axis(flight, "CZ")
    short = flight_of(aircraft, 1.0)
    with pytest.raises(InputError, match="too few"):
        fit_axis(short, "CZ")


def test_ten_minutes_are_quick(aircraft) -> None:
    """Hundreds of candidates in six axes have some seconds: 20 ms each on a busy machine, 1 ms on a free one."""
    flight = flight_of(aircraft, 600.0)
    base, column = fit_axis(flight, "CZ"), flight.signal("beta")[:, None]
    base.gain(column)
    times = []
    for _ in range(20):
        begin = time.perf_counter()
        base.gain(column)
        times.append(time.perf_counter() - begin)
    assert min(times) < 0.02


def test_flights_with_constants_of_their_own_are_fitted_as_with_a_column_for_each(aircraft) -> None:
    """The same slopes as least squares with a dummy variable per flight (Frisch, Waugh and Lovell)."""
    flight, flown = flight_of(aircraft), np.repeat(np.arange(10), 300)
    biased = flight.measured + np.random.default_rng(2).normal(size=10)[flown][:, None]
    flight = replace(flight, measured=biased, manoeuvre=flown, flown=flown)
    fit = fit_axis(flight, "CZ")
    plain = replace(flight, flown=None).columns(flight.model.programs[AXES.index("CZ")])
    dummies = (flown[:, None] == np.arange(10)).astype(float)
    expected, *_ = np.linalg.lstsq(np.hstack([plain[:, 1:], dummies]), biased[:, AXES.index("CZ")], rcond=None)
    assert fit.fit.parameters[1:] == pytest.approx(expected[:3], rel=1e-9)
    assert fit.fit.parameters[0] == pytest.approx(np.mean(expected[3:]), rel=1e-6)
    assert fit_axis(replace(flight, flown=None), "CZ").nrmse_fit > 3.0 * fit.nrmse_fit
