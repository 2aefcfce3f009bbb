"""Everything that was chosen is chosen once more without each quarter of a flight, which is then predicted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_intervals import flight_of

from aircraft_sysid_ros.diagnosis import diagnose
from aircraft_sysid_ros.diagnosis.finding import Finding, NestedValidation
from aircraft_sysid_ros.diagnosis.flight.flight_data import BLOCK, FOLDS
from aircraft_sysid_ros.diagnosis.nested_validation import nested_validation
from aircraft_sysid_ros.diagnosis.search.candidates import Candidate
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.diagnosis.words import chosen_anew
from aircraft_sysid_ros.effects import BY_ID


@pytest.fixture(scope="module")
def bench(aircraft):
    return CandidateEvaluator(flight_of(aircraft, 4))


@pytest.fixture
def here(monkeypatch):
    """What is chosen is chosen in this process, where a test can see it."""
    monkeypatch.setenv("AIRCRAFT_SYSID_CORES", "1")


def found(bench, candidate):
    trial = bench.trial(candidate)
    return Finding(trial, bench.data, 0.0, 0.0, 0.0, 0.0, 0.0)


def candidate_of(effect, **terms):
    return Candidate(BY_ID[effect], "", (), {axis: (text,) for axis, text in terms.items()})


def of(*inner, **terms):
    return Candidate(None, "", inner, {axis: (text,) for axis, text in terms.items()})


def test_of_one_choice_for_all_parts_it_is_the_held_out_error(bench):
    finding = found(bench, of(CZ="abs(de)"))
    same = nested_validation(finding, bench, lambda part: finding)
    assert same.error == pytest.approx(finding.trial.gains["CZ"].nrmse_after, rel=1e-9)
    nothing = nested_validation(finding, bench, lambda part: None)
    assert nothing.error == pytest.approx(bench.fits["CZ"].nrmse_held_out, rel=1e-12)
    assert nothing.names == ("",) * FOLDS and same.names == ("CZ: abs(de)",) * FOLDS


def test_every_block_is_hidden_once_but_those_in_which_a_change_begins_or_ends(bench, here):
    moments = ("t0", 251.0), ("t1", 514.6)
    finding, seen = found(bench, of(*moments, CZ="max(sign(time-(251)),0)-max(sign(time-(514.6)),0)")), []

    def choice(part):
        seen.append(np.isfinite(part.data.measured[:, 2]))
        return finding

    nested = nested_validation(finding, bench, choice)
    hidden = len(seen) - np.sum(seen, axis=0)
    edges = np.isin(bench.data.block, [50, 102, 103])  # 514.6 s is known to a second, and 515 s is a border
    assert len(seen) == FOLDS == len(nested.names) and not hidden[edges].any() and np.all(hidden[~edges] == 1)
    for each in seen:
        assert len(np.unique(bench.data.block[~each] % FOLDS)) == 1
    judged = finding.trial.gains["CZ"]
    apart = ~np.isin(judged.fit.blocks, [50, 102, 103])
    left = np.sqrt(judged.after[apart].sum() / judged.before[apart].sum())
    assert nested.error == pytest.approx(judged.nrmse_before * left, rel=1e-9)
    assert BLOCK * 50 <= 251.0 < BLOCK * 51


def test_what_differs_by_name_only_comes_again_and_is_said(bench):
    """loss_of_thrust and tow_line are a stated set; flaps and loss_of_thrust are not."""
    named = replace(
        found(bench, candidate_of("loss_of_thrust", CZ="abs(de)")),
        nested=NestedValidation(("tow_line", "tow_line", "loss_of_thrust", "flaps"), 0.5),
    )
    assert named.times_again == 3 and named.comes_again and named.not_told_from == ("tow_line",)
    other = replace(named, nested=NestedValidation(("flaps", "flaps", "", "loss_of_thrust"), 0.5))
    assert not other.comes_again and other.not_told_from == ()


@pytest.mark.long
def test_the_best_of_many_moments_of_nothing_explains_nothing_of_what_it_was_not_chosen_on(aircraft, here):
    """A step at the best of many moments lowers the held-out error of noise, but not that of flight it did not see."""
    gains, nested = [], []
    for seed in range(6):
        flight = flight_of(aircraft, 10 + seed, with_flaps=False)
        random, count = np.random.default_rng(seed), len(flight.time)
        noise = np.convolve(random.normal(size=count + 40), np.ones(41) / 41.0, mode="valid")
        measured = flight.measured.copy()
        measured[:, 2] += 0.02 * noise / noise.std()
        whole = CandidateEvaluator(replace(flight, measured=measured))

        def best(part, bench=whole):
            steps = [of(CZ=f"max(sign(time-({t:g})),0)*{by}") for t in range(40, 860, 20) for by in ("alpha", "q", "1")]
            return found(bench, max(steps, key=lambda step: part.trial(step).score))

        finding = best(whole)
        before = whole.fits["CZ"].nrmse_held_out
        gains.append(np.log(before / finding.trial.gains["CZ"].nrmse_after))
        nested.append(np.log(before / nested_validation(finding, whole, best).error))
    assert min(gains) > 0.0 and np.mean(nested) < 0.5 * np.mean(gains)


def test_it_is_said_in_words():
    candidate = {
        "label": "stall",
        "main_axis": "CZ",
        "nested": {"parts": 4, "same": 4, "others": [], "error_after": 0.12},
    }
    assert chosen_anew(candidate) == (
        "chosen again with each quarter of the flight left out: the same in 4 of 4; error of CZ in the quarters left "
        "out 12 %"
    )
    candidate["nested"] |= {"same": 2, "others": ["icing", ""]}
    assert "the same in 2 of 4 (else icing and nothing);" in chosen_anew(candidate)
    assert not chosen_anew({"nested": None}) and not chosen_anew({})


class Pass:
    """A pass of the search that names the first of what it is given; it finds this on each part, then that."""

    def __init__(self, *parts):
        self.parts, self.asked = parts, []

    def named(self, significant, before, surer=False):
        self.asked.append((tuple(f.trial.main_axis for f in significant), surer))
        return next(iter(significant), None)

    def findings(self, before):
        return self.parts[0]

    def on(self, bench):
        return self

    def after(self, named):
        return Pass(*self.parts[1:])


def test_what_does_not_come_again_hides_nothing_that_is_missing_in_another_axis(bench, monkeypatch):
    pitch, lift = found(bench, of(Cm="abs(de)")), found(bench, of(CZ="abs(de)"))
    names = {"Cm": ("", "", "", "Cm: abs(de)"), "CZ": ("CZ: abs(de)",) * 4}
    monkeypatch.setattr(
        diagnose, "nested_validation", lambda best, *_: NestedValidation(names[best.trial.main_axis], 0.1)
    )
    one, unsure = Pass(), {}
    named, refused = diagnose._named_and_again(one, [pitch, lift], (), bench, unsure)
    assert named.trial is lift.trial and named.comes_again
    assert [f.is_unsure for f in refused.values()] == [True] and list(unsure) == ["Cm"]
    # the second is asked for with the surer level, and of an axis that is as it was nobody asks again
    assert one.asked == [(("Cm", "CZ"), False), (("CZ",), True)]
    one.asked.clear()
    assert diagnose._named_and_again(one, [pitch], (named,), bench, unsure) == (None, {}) and one.asked == [((), True)]
    other = bench.extended({"Cm": ["abs(de)"]})
    assert diagnose._named_and_again(Pass(), [pitch], (named,), other, unsure)[1] != {}


def test_where_something_else_leads_in_a_part_what_was_named_is_asked_for_after_it(bench):
    lift, pitch, other = (found(bench, of(**terms)) for terms in ({"CZ": "abs(de)"}, {"Cm": "abs(de)"}, {"Cm": "V"}))
    both = found(bench, of(Cm="q*q", CZ="q*q"))

    def anew(*parts, best=pitch):
        return diagnose._named_anew(Pass(*parts), (), best, bench)

    assert anew([pitch, lift]) is pitch and anew([]) is None
    # of another axis, what is named of this one
    assert anew([lift, pitch]) is pitch and anew([lift]) is None
    assert anew([lift, both], best=replace(both, confounded_with=())) is both
    # another effect in it, what follows that; and where it does not, that one
    named = replace(found(bench, candidate_of("stall", Cm="abs(de)")), confounded_with=("icing",))
    again = found(bench, candidate_of("icing", Cm="abs(de)"))
    assert anew([other], [again], best=named) is again and anew([other], [lift], best=named) is other
    assert anew([other], [], best=named) is other
