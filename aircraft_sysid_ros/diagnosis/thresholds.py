"""The thresholds that decide what is diagnosed, in one record, each with the reason of its value.

Rules were made while the flights "tuned on" of ``make hidden-effects`` were looked at, and judged on fresh ones:
docs/diagnosis.md, which lists this record. What rests on no more than that says "a judgement".
"""

from __future__ import annotations

from dataclasses import dataclass

from aircraft_sysid_ros.threshold import threshold


@dataclass(frozen=True)
class Thresholds:
    """Limits of a diagnosis. Logarithms are natural, of ratios of held-out sums of squares."""

    # -- the flight
    shortest: float = threshold(
        20.0,
        "Flight [s] from which anything is said, for many manoeuvres in all: a block of 5 s in each of the four groups",
        "that take turns.",
    )
    least_time: float = threshold(
        10.0,
        "Flight without a gap [s] that replicas can repeat, for many manoeuvres in all: two blocks, one to fit and one",
        "to hold out.",
    )
    settled: float = threshold(
        1.5,
        "The flight counts from where the air data are known this much worse than usual, at most: the filter begins by",
        "allowing for gusts, and flow angles are worse until it knows. A judgement.",
    )
    least_noise: float = threshold(
        0.5,
        "Least noise of a sensor, over that of the file, that third differences are believed to show: a sensor that",
        "rounds or repeats its values seems to have none. A judgement.",
    )
    most_noise: float = threshold(
        4.0,
        "And the largest: beyond it a sensor is faulty rather than noisy. A judgement.",
    )
    calm: float = threshold(
        0.15,
        "Random walk of the wind [m/s per √s] above which a scale of the air data cannot be told from gusts that are",
        "stronger in one direction than in another.",
    )
    wrong_for: float = threshold(
        30.0,
        "A state that was given up, since GPS contradicted it, had been wrong for this long [s]. A judgement.",
    )

    rolling: float = threshold(
        20.0,
        "What lies this near [s] to a time at which it was too slow to fly is left out: it may have been on its",
        "wheels. A jet that touches down at twice the least airspeed and slows down by 0.2 g needs as long. A",
        "judgement.",
    )
    rolling_speed: float = threshold(
        1.2,
        "A flight begins or ends too slow to fly where its airspeed there is below this many times the least one:",
        "slower points do not count. A judgement.",
    )

    # -- significance and size
    false_alarm: float = threshold(
        0.05,
        "Probability that a flight in which nothing is missing has anything in the list of candidates: the usual",
        "level.",
    )
    verdict: float = threshold(0.01, "The same for a verdict, which needs size as well.")
    further: float = threshold(
        1e-3,
        "The same for an effect after the first one: what that leaves, since it has not quite the true shape,",
        "is in no replica. A judgement.",
    )
    again: float = threshold(
        0.5,
        "What is named must be chosen again, it or what the flight cannot tell from it, in more than this share of the",
        "choices that are made without a part of the flight. A judgement.",
    )
    size: float = threshold(
        0.10,
        "Share of the held-out rms error of an axis that an effect must explain: what is true but tiny is listed and",
        "not called missing.",
    )
    least_moved: float = threshold(
        0.02,
        "Share of the spread of a coefficient that an effect must make: scales and places of sensors that no file",
        "knows to the last percent make as much. On a clean flight one of 0.012 had been a verdict; of 747 flights",
        "with an effect one is lost.",
    )
    above_floor: float = threshold(
        1.4,
        "Held-out error of an axis over that of the replicas, or over what is left of it where that is less, from",
        "which something may be called missing in it: sensors that smooth and round, and gusts of another spectrum,",
        "leave a third more on clean flights of other makers. Of the flights with a relevant effect that the rules",
        "were made on 2 % are lost.",
    )
    shrinkage: float = threshold(
        4.0,
        "Weight of the spread over all candidates, in replicas, against that of the candidate itself: few replicas",
        "say little of the spread of one, and with five the two count alike.",
    )
    least_spread: float = threshold(
        0.004,
        "Least standard deviation of a score over replicas: where they are alike by chance anything would be",
        "significant. Small beside the 0.2 that an effect of the least size scores.",
    )
    doubt: float = threshold(
        1.0,
        "What replicas show of a candidate is known to within this many times its own size: it comes from gusts, and",
        "those of the flight are not those of the replicas.",
    )
    inferred_error: float = threshold(
        0.7,
        "Where flow angles are inferred, a delay of the controls must leave no more of the spread of a moment: half",
        "of its variance must be explained.",
    )
    left: float = threshold(
        0.25,
        "What is left of an axis, as a share of its spread, above which the answer says so even where it has no name",
        "for it. A judgement: in variance it is a sixteenth.",
    )
    left_times: float = threshold(3.0, "And over the error of the replicas, as for parameters that are held.")
    left_most: float = threshold(
        0.5, "The share above which most is left: the limit at which parameters are held for that."
    )
    left_axes: int = threshold(
        2,
        "Axes of which most is left, besides its own, among which an effect must explain most of what is above the",
        "noise: replicas fly a model that is right, and such a flight has none. On one half of a real flight whose",
        "surfaces are commands a stall had been named that explained a quarter.",
    )
    left_share: float = threshold(
        0.67,
        "The share of the variance above the noise that it must explain then. At a half the second half of that flight",
        "had a limit of the elevator's rate named, which explains less than a half in the first and in the whole.",
    )
    trim_size: float = threshold(
        0.5,
        "Share of what is left of the trim of a long flight that a change must explain: on the simulated flights that",
        "the rule was made on true ones explain 85 to 95 %, the likeliest of clean ones 5 %.",
    )
    trim_left: float = threshold(
        0.05,
        "What is left of the trim, over what the elevator makes of it, from which it is reported. A judgement.",
    )
    trim_told: float = threshold(
        3.0,
        "ln of the likelihood by which a change that follows lift must be told from a constant one. A judgement.",
    )
    most_effects: int = threshold(
        4, "Effects that are looked for one after another, each with those before it in the model."
    )

    # -- which name
    enough: float = threshold(
        0.8,
        "An effect that explains less than this share of the error variance that an expression explains in an axis is",
        "not the cause: without this, more than half of the flights whose effect the library lacked got a name.",
    )
    clearly: float = threshold(
        0.2, "Nor is one that leaves this much more of it, in ln: a tenth of the rms error, as size."
    )
    preference: float = threshold(
        0.1,
        "And over all axes the expression must explain this much more, in ln: of hundreds of expressions one is better",
        "than the truth by chance.",
    )
    preference_share: float = threshold(0.2, "Or this share of what the effect explains, where that is more.")
    alike: float = threshold(
        0.9,
        "Candidates are told apart when what they explain correlates less: at 0.9 one explains four fifths of the",
        "other.",
    )
    as_good: float = threshold(
        0.8, "Or when one explains less than this share of what the other explains. A judgement."
    )
    nearly: float = threshold(
        0.97,
        "Of effects that explain nearly as much as the best, that of the fewest terms is named. A judgement.",
    )
    change_gain: float = threshold(
        0.1,
        "ln of the error variance that a term of a change at one moment must gain: 5 % of the rms error, half of size.",
    )

    # -- the measurement
    setting_gain: float = threshold(
        0.02,
        "Gain of the log-likelihood per sample of air data below which a setting is, in gusts, as good as that of the",
        "file: gusts are not a random walk, which leaves some tenths of this to gain.",
    )
    setting_total: float = threshold(20.0, "And at least this in all, which is enough in calm air: far beyond chance.")
    least_scale: float = threshold(
        0.03,
        "A scale of the airspeed that is nearer to 1, or a drift of it that grows to less, changes no coefficient by a",
        "tenth of itself, with its square. Attitudes that are wrong by some tenths of a degree look like that.",
    )
    least_angle_scale: float = threshold(
        0.05,
        "The same for a flow angle: derivatives are as wrong as it is, half of a tenth. A vane with inertia",
        "loses some per cent of quick motion.",
    )
    least_offset: float = threshold(
        0.012,
        "Offset of a flow angle [rad], or what a drift grows to in the flight, below which it is not named: an",
        "attitude that is half a degree wrong looks the same.",
    )
    half_against: float = threshold(
        3.0,
        "ln by which half of the flight may be likelier without a setting that the whole prefers: a half in which it",
        "hardly shows says nothing, one in which it is not there speaks against it. A judgement.",
    )
    worse: float = threshold(
        0.02,
        "Mean ln of the held-out errors with a setting over those without, above which it is refused. Noise alone",
        "makes some thousandths.",
    )
    least_delay: float = threshold(
        0.02,
        "A delay of a sensor [s] below which it is taken into account and is not a fault. A judgement.",
    )
    least_delay_share: float = threshold(
        0.6,
        "Or this share of the time from sample to sample: a sensor that averages over it is half of it late.",
    )
    left_out: float = threshold(
        0.5,
        "A place of a sensor that the file does not state goes before a fault with up to twice its evidence; what the",
        "fault explains beyond it is found next. A judgement.",
    )
    gust_lag: float = threshold(
        0.05,
        "Lag of the air data [s] for which that holds: gusts of another spectrum look like short ones, which need",
        "more.",
    )
    control_gain: float = threshold(
        0.25,
        "ln of the error variance, over the moments, that a delay of the controls must gain: the second step judges",
        "it, and a delay that smooths gains something in any flight.",
    )
    most_settings: int = threshold(
        4, "Settings of the aircraft file that are corrected one after another, faults or not."
    )
    setting_as_good: float = threshold(
        0.75,
        "A second setting with this share of the evidence of the first cannot be told from it. A judgement.",
    )

    # -- inputs that fail
    failure_evidence: float = threshold(
        30.0,
        "ln of the likelihood, less what free parameters cost, from which an input is said to have failed: of",
        "simulated flights in which nothing failed none has one that meets all rules (docs/diagnosis.md).",
    )
    acceleration_evidence: float = threshold(
        60.0,
        "The same where a balance of moments is solved for the acceleration, twice as much: a clean simulated flight",
        "had 37 at 10 Hz, failures that only this form shows had 110 to 510.",
    )
    failure_lead: float = threshold(
        10.0,
        "And it must be so much likelier than that the same axes have another constant for a while. A judgement.",
    )
    part_evidence: float = threshold(
        90.0,
        "And that from which an input is said to keep part of its effect: of 20 clean flights, eight of JSBSim, the",
        "most with a loss had 45; eight of nine surfaces that kept 0.35 to 0.58 had 96 to 2000, in one of both forms.",
    )
    unrecorded_evidence: float = threshold(
        130.0,
        "And that from which such a constant is said to be there where no input that failed is named: of 38 clean",
        "flights, ten of JSBSim, the most had 99; of 16 with a rudder hard over all but three 174 to 1500.",
    )
    unrecorded_size: float = threshold(
        0.05,
        "Share of the error that it must take: evidence grows with the length of a flight, and a model that is nearly",
        "right would change a little in any long one. The clean flights had 0.05 at most.",
    )
    unrecorded_explained: float = threshold(
        0.3,
        "Share of the axis that the model with such a change must explain, or nothing is known of what else it does:",
        "a clean flight of JSBSim that seemed to have one had 0.12, twelve with a rudder or a part of an aileron 0.56",
        "to 0.97.",
    )

    # -- in flight
    live_size: float = threshold(
        0.20,
        "Share of the rms error that an effect must explain in flight: twice that after the flight, since there are no",
        "replicas.",
    )
    live_level: float = threshold(
        1e-6,
        "Level of the test in flight, over all candidates: small for the sake of the errors of the flow angles, which",
        "are not in its covariance; it is not a false-alarm rate.",
    )
    live_least: float = threshold(
        60.0, "Settled flight [s] from which anything is judged: manoeuvres must have been repeated."
    )

    # -- compare and add
    odd_noise: float = threshold(
        1.6,
        "Fast part of a residual over the noise of the file, or its inverse, from which a note says that the file is",
        "wrong: three times as far from 1 as the errors of clean flights are from their floor (docs/compare.md).",
    )
    far_above: float = threshold(1.5, "Held-out error over its floor from which a residual of only noise gets a note.")
    failing: float = threshold(
        1.5,
        "Rms residual over the noise from which a place is listed: the noise of a real aircraft is not known to the",
        "last percent.",
    )
    least_fall: float = threshold(0.01, "Fall of a held-out error by which an addition improves a model. A judgement.")


THRESHOLDS = Thresholds()
