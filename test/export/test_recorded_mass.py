"""Of a recording with mass properties the coefficients are worked out with these, and so is all that rests on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.commands.export import notes_on
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run
from aircraft_sysid_ros.export.from_run import learnt_model
from aircraft_sysid_ros.export.level_flight import airspeeds_of, level_flight
from aircraft_sysid_ros.samples import Kind, concatenate, samples_of


def run_with(folder, *rows):
    """A run whose recording has rows (8,) of mass properties, one after another."""
    run = open_run(folder)
    first = int(run.samples.stamp.min())
    mass = samples_of(Kind.MASS, first + np.arange(len(rows)), np.array(rows))
    return replace(run, samples=concatenate([mass, run.samples]))


def test_trims_carry_the_recorded_mass(exported_run):
    """They had carried that of the file: an aeroplane of 1.25 times that flew level 1.1 deg too flat."""
    filed = open_run(exported_run).root
    mass, xx, yy, zz, xz = 1.25 * filed.mass, 0.2, 0.3, 0.4, 0.02
    run = run_with(exported_run, [mass, xx, yy, zz, xz, 0.02, 0.0, 0.01])
    heavy = learnt_model(run, run.current)
    assert heavy.aircraft.mass == mass
    assert heavy.aircraft.inertia.tolist() == [[xx, 0.0, -xz], [0.0, yy, 0.0], [-xz, 0.0, zz]]
    assert heavy.aircraft.aerodynamic_reference == pytest.approx(filed.aerodynamic_reference - [0.02, 0.0, 0.01])
    level = level_flight(heavy, airspeeds_of(heavy)[0])
    lift = heavy.coefficients_of(heavy.terms_on(level.signals[None]))[0, 2]
    down = -lift * 0.5 * level.density * level.airspeed**2 * filed.wing_area
    assert down == pytest.approx(mass * 9.80665 * np.cos(level.alpha) * np.cos(level.bank), rel=1e-4)
    (note,) = (note for note in notes_on(run, heavy) if "recording" in note)
    assert f"{mass:.4g} kg" in note and f"{filed.mass:.4g} kg" in note


def test_what_is_not_recorded_is_as_in_the_file_and_a_mass_that_changes_is_said(exported_run):
    filed, nothing = open_run(exported_run).root, [np.nan] * 7
    run = run_with(exported_run, *([share * filed.mass, *nothing] for share in (1.2, 1.1, 1.0)))
    learnt = learnt_model(run, run.current)
    assert learnt.aircraft.mass == 1.1 * filed.mass and learnt.aircraft.inertia.tolist() == filed.inertia.tolist()
    (note,) = (note for note in notes_on(run, learnt) if "recording" in note)
    assert f"{filed.mass:.4g} to {1.2 * filed.mass:.4g} kg" in note


def test_without_mass_properties_nothing_is_said(exported_run):
    run = open_run(exported_run)
    learnt = learnt_model(run, run.current)
    assert learnt.aircraft.mass == run.root.mass and not any("mass" in note for note in notes_on(run, learnt))


def test_an_absurd_mass_is_no_mass_and_a_centre_of_gravity_alone_is_said(exported_run):
    """The mass was "the middle of 0 to 2.4 kg", and of a recorded centre of gravity nothing was said."""
    filed = open_run(exported_run).root
    unknown = [np.nan] * 4
    for absurd in (0.0, -1.0, 1e9):
        run = run_with(exported_run, [absurd, *unknown, 0.0, 0.0, 0.0], [filed.mass, *unknown, 0.0, 0.0, 0.0])
        learnt = learnt_model(run, run.current)
        assert learnt.aircraft.mass == filed.mass and not any("recording" in note for note in notes_on(run, learnt))
    run = run_with(exported_run, [np.nan, *unknown, 0.03, 0.0, 0.0])
    (note,) = (note for note in notes_on(run, learnt_model(run, run.current)) if "recording" in note)
    assert note == "as in the recording, and not as in the aircraft file: centre of gravity"
