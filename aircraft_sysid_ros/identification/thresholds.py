"""The thresholds that decide what is published of a flight, in one record, each with the reason of its value.

Whether a parameter is USE, HOLD or REJECT, when an axis is held, learnt anew and released, and when a sensor or the
aeroplane is blamed. docs/trust.md lists this record. What rests on no more than that says "a judgement".

Samples are evaluations of the coefficients, 25 per second. A spread is the standard deviation of a coefficient.
"""

from __future__ import annotations

from dataclasses import dataclass

from aircraft_sysid_ros.threshold import threshold


@dataclass(frozen=True)
class Thresholds:
    """Limits of what is published."""

    # -- the verdict on one parameter
    excitation: float = threshold(
        3.0, "Least ratio of what only its term moves to the noise of that: at 3 the noise biases the value by 11 %."
    )
    relative_error: float = threshold(0.25, "Largest standard error over the value. A judgement.")
    negligible: float = threshold(
        0.05, "Unless the standard error moves the coefficient by less than this share of its spread. A judgement."
    )
    samples: int = threshold(100, "Samples that an axis has learnt from before anything of it is trusted. A judgement.")
    constant_noise: float = threshold(
        0.01, "A constant term is compared with this where others are compared with their noise. A judgement."
    )
    follows: float = threshold(
        0.8,
        "Share of the square of a term that others explain from which the reason says that it follows them. A",
        "judgement.",
    )
    bounds: tuple[tuple[str, tuple[float, float]], ...] = threshold(
        (
            ("CZ_alpha", (-15.0, 0.0)), ("CZ_q", (-60.0, 5.0)), ("Cm_q", (-200.0, 0.0)), ("Cl_p", (-3.0, 0.0)),
            ("Cn_r", (-3.0, 0.0)), ("CY_beta", (-5.0, 0.0)), ("Cm_alpha", (-20.0, 20.0)), ("Cn_beta", (-1.0, 2.0)),
            ("Cl_beta", (-2.0, 1.0)), ("CX_Tc", (0.4, 1.6)),
        ),
        "Lowest and highest value that any aeroplane has. That of C_X,Tc is near 1, since T_c is the thrust itself. A",
        "judgement.",
    )  # fmt: skip
    bounds_of_terms: tuple[tuple[str, float], ...] = threshold(
        (
            ("0", 3.0), ("alpha", 20.0), ("beta", 10.0), ("p", 50.0), ("q", 300.0), ("r", 50.0), ("de", 5.0),
            ("da", 5.0), ("dr", 5.0),
        ),
        "Largest size of a parameter that has no bounds of its own, by its term. A judgement.",
    )  # fmt: skip
    beyond_bounds: float = threshold(
        2.0,
        "Standard errors by which a value must be beyond what aeroplanes have, or beyond the bounds of the aircraft",
        "file, for REJECT: within them it has HOLD. A judgement.",
    )
    undefined: float = threshold(
        10.0,
        "Time [s] of flight over which a term has been a number, after it was none, before its parameter is judged",
        "again. A judgement.",
    )
    inferred_seconds: float = threshold(
        20.0,
        "Time [s] in which wind and attitude must show an angle that no vane measures before an axis that needs it is",
        "used, as much as any comparison of a model needs: less is of one manoeuvre and one error of the wind. Of five",
        "values that were to be used in such flights of a stranger four were more than a quarter off.",
    )
    inferred_share: float = threshold(
        1.5,
        "What one sigma of an inferred angle does to a coefficient, over what a parameter does, from which that has",
        "HOLD: an eighth of it ends in each other term, in flights of a jet without a sideslip vane.",
    )
    inferred_motion: float = threshold(
        0.3,
        "Least share of an inferred angle that is not noise for which its derivative, which noise makes smaller, is",
        "put right. A judgement.",
    )

    # -- which estimator `auto` publishes
    gust_share: float = threshold(
        3.0,
        "Error of the filter's angles over the noise of a vane in the differentiating window (variances) from which",
        "gusts make it late. On simulated flights it was 0.4 to 1.6 in calm air and 6 to 35 in turbulence, vanes at 2",
        "to 50 Hz and the IMU at 10 to 100 Hz.",
    )
    gusts_last: float = threshold(
        20.0,
        "Time [s] of flight that has to be late, more than not: the filter begins by allowing for gusts. A judgement.",
    )

    # -- a model that does not explain its coefficient
    misfit: float = threshold(
        0.5,
        "Rms error over the spread from which the model does not explain the coefficient: a quarter of the variance.",
        "With a right model it was at most 0.1 in calm air and 0.4 in turbulence, on Thor it is 0.7 for C_l and 0.8",
        "for C_m.",
    )
    beyond_noise: float = threshold(
        3.0,
        "Rms error over what noise makes of it from which the model lacks something. With right models it was at most",
        "1.9 at the end of a flight and 2.2 on the way, in any air, at 10 to 400 Hz",
        "(benchmarks/results/lack_of_fit.json).",
    )
    least_motion: float = threshold(
        0.1,
        "A second in which a coefficient has less than this share of its variance says nothing of the model: in cruise",
        "all is noise. A judgement.",
    )
    least_blocks: int = threshold(
        8,
        "Seconds of motion that there must be before an axis has a usual error, and before the model is said not to",
        "explain it. A judgement.",
    )
    tenth_blocks: int = threshold(
        20, "Seconds of motion of which a tenth says something: one is chance, or the first that was learnt from."
    )
    little_known: float = threshold(
        1.0,
        "Variance of a prediction by least squares over that of noise from which a sample says nothing of the model. A",
        "judgement.",
    )
    little_known_of_another: float = threshold(
        0.1, "The same where another estimator is published: what it knows from little it takes for sure. A judgement."
    )
    judged: int = threshold(
        40,
        "Seconds of motion after which a flight judges by itself what was in doubt when a model was saved, or when",
        "other axes got other terms. A judgement.",
    )
    white_windows: int = threshold(
        10, "Windows that share nothing from which on it is said that a residual is white. A judgement."
    )
    white_sigma: float = threshold(
        2.58, "Standard errors of its correlation within which a residual is white: white noise is in 99 % of windows."
    )

    # -- two estimates that disagree, least squares of now and before, and of two ranges of the angle of attack
    disagree_sigma: float = threshold(
        6.0, "Standard errors of their difference beyond which two estimates of a parameter disagree. A judgement."
    )
    disagree_share: float = threshold(0.25, "And beyond this share of the value. A judgement.")
    disagree_effect: float = threshold(
        0.05, "And where the difference moves the coefficient by more than this share of its spread. A judgement."
    )
    disagree_blocks: int = threshold(
        3,
        "Blocks of 5 s of motion before the newest 15 s that there must be to compare least squares with itself. A",
        "judgement.",
    )
    range_blocks: int = threshold(
        20, "Seconds of motion that there must be at smaller and at larger angles of attack. A judgement."
    )
    range_spare: int = threshold(
        4,
        "Clusters of 2 s of either part beyond the number of terms, whose scatter says how well it is known. A",
        "judgement.",
    )
    range_surely: float = threshold(
        16.0,
        "F from which two ranges disagree, about four standard errors in each parameter. With right models it was at",
        "most 9 at any time of 35 flights; in eleven axes of nine flights through stalls it was 24 to 386",
        "(benchmarks/stalls.py, flights of another maker).",
    )
    range_effect: float = threshold(
        0.1, "And the difference must move the coefficient by this share of its spread. A judgement."
    )
    range_alike: float = threshold(
        4.0, "Largest F of the parameters that agree, two standard errors in each. A judgement."
    )
    range_near: float = threshold(
        0.25,
        "Share of a value that a parameter which agrees may be off by in either range to be spared: from a quarter on",
        "a value counts as wrong.",
    )
    range_sigma: float = threshold(
        3.0, "By so many standard errors: what is off by a quarter passes in one of 700 cases."
    )

    # -- an error that is too large
    alarm: tuple[float, float] = threshold(
        (3.0, 2.0),
        "Rms error of the newest second of motion over the usual, and over the largest second of the newest minute,",
        "from which an axis is held. A judgement.",
    )
    first_sign: tuple[float, float] = threshold(
        (2.0, 1.3), "The same for the first sign of what is wrong: what is held goes back to before it. A judgement."
    )
    normal: tuple[float, float] = threshold((2.0, 1.3), "And below which the error is normal again. A judgement.")
    slight: tuple[float, float] = threshold(
        (1.5, 1.0), "And from which is asked whether what was known some time ago predicts better. A judgement."
    )
    alarm_looks: int = threshold(2, "Looks in a row that make an alarm. A judgement.")
    window_spread: float = threshold(
        2.0,
        "A window that is spread over more than this many times its length does not count: in cruise an axis learns",
        "now and then, from what is not motion.",
    )
    quieter_axes: int = threshold(
        2,
        "How many axes are quieter than the one that tells by what the errors of all have grown, which is not counted:",
        "gusts and noise raise the errors of most axes, a change of the aeroplane those of some.",
    )
    worse: float = threshold(
        2.0,
        "Learning has made an axis worse where the mean square error is this many times that of what was known some",
        "time ago. A judgement.",
    )
    worse_since: float = threshold(10.0, "That time ago [s]. A judgement.")
    new_motion: float = threshold(
        2.0,
        "Mean square of a term over that of what an axis has learnt from, beyond which it moves as it never did. What",
        "hardly moved has a parameter that noise made, and the first motion says so. A judgement.",
    )

    # -- an axis that has changed, and is learnt anew
    change_ratio: float = threshold(
        5.0,
        "Rms error of the newest second of motion over that of the minute before it from which the aeroplane has",
        "changed. A judgement.",
    )
    change_worst: float = threshold(
        3.0,
        "And over the worst second of that: errors of a model that is always wrong somewhere raise the bar by",
        "themselves. A judgement.",
    )
    change_looks: int = threshold(2, "Looks in a row that make a change. A judgement.")
    change_known: int = threshold(
        250, "Samples that an axis has learnt from before its errors count: ten seconds. A judgement."
    )
    change_at_odds: float = threshold(
        2.0,
        "Mean normalised innovation squared from which errors tell no change of the aeroplane: half of that from which",
        "nothing is learnt.",
    )
    change_late: float = threshold(
        3.0, "Standard errors by which surfaces may be late, which is no change. A judgement."
    )
    change_asked: tuple[float, ...] = threshold(
        (6.0, 9.0, 12.0, 15.0, 18.0),
        "Times [s] after a change at which is asked whether it was still going on, as flaps do: five values of such a",
        "flight were wrong by 4 to 8 standard errors a minute later, or everything was held to the end.",
    )
    change_newest: float = threshold(
        4.0, "By the samples of so long [s], from which the axis then starts over. A judgement."
    )
    change_surely: float = threshold(
        4.0, "Standard errors by which the level before them must differ for that. A judgement."
    )

    # -- signs that a sensor is wrong
    most_inconsistent: float = threshold(
        4.0,
        "Mean normalised innovation squared of the first step from which nothing is learnt: a sensor lies. A",
        "judgement.",
    )
    largest_accelerometer_bias: float = threshold(
        2.0,
        "Nor with a bias [m/s²] that no working IMU has: it is mounted or scaled in another way than the recording",
        "says. A judgement.",
    )
    largest_gyro_bias: float = threshold(0.3, "The same of a gyro [rad/s]. A judgement.")
    inconsistent: float = threshold(
        1.8, "Mean normalised innovation squared that working sensors do not have for some looks in a row. A judgement."
    )
    inconsistent_looks: int = threshold(3, "So many looks: gusts that set in have it at one or two.")
    too_quiet: float = threshold(
        0.8,
        "The same over its median of a minute: what stands still is without noise, and too well predicted. Noise has",
        "other reasons to fall, so that it counts only after another sign. A judgement.",
    )
    quiet_time: float = threshold(2.0, "Time [s] for which it must be below that. A judgement.")
    most_rejected: float = threshold(7.0, "Measurements that may fail the gate within ``rejected_time``. A judgement.")
    rejected_time: float = threshold(2.0, "That time [s]. A judgement.")
    leap: float = threshold(
        8.0, "Standard deviations of its movement over ``leap_time`` from which a bias leaps. A judgement."
    )
    leap_time: float = threshold(3.0, "That time [s]. A judgement.")
    least_leap: tuple[float, float] = threshold(
        (0.05, 0.005), "And by so much at least, of accelerometer [m/s²] and gyro [rad/s]. A judgement."
    )
    longest_gap: float = threshold(0.5, "States this far apart [s]: the first step had to start again. A judgement.")
    agitation: float = threshold(
        4.0,
        "Wind that moves within a second by this many times what it did in the last minute follows a sensor rather",
        "than the air. Gusts do so too: it counts only beside a model error. A judgement.",
    )
    least_agitation: float = threshold(0.4, "And by so much [m/s] at least. A judgement.")

    # -- what contradicts what was known
    known_surely: float = threshold(
        0.05, "Standard error over the value of what is surely known, as of a value that counts as confidently wrong."
    )
    known_better: float = threshold(
        0.7,
        "Standard error over that of what was known best, for a value to take its place: twice the data, so that what",
        "creeps is followed by one step at most while they come; and what is known better is not in doubt.",
    )
    known_near: float = threshold(
        0.1, "Learning goes back to what is as near as this share to what is known best. A judgement."
    )
    contradicts_share: float = threshold(
        0.2,
        "A value contradicts what was known beyond this share of it, below the quarter from which a value counts as",
        "wrong: learning is rarely off by more than a tenth.",
    )
    contradicts_sigma: float = threshold(
        4.0, "And beyond this many standard errors: in gusts those of `fourier` are too small by up to a third."
    )
    contradicts_effect: float = threshold(
        0.1,
        "And where it moves the coefficient by this share of its spread: what nothing depends on is badly known and",
        "changes often.",
    )
    alike: float = threshold(
        0.2,
        "Ratios of now to before that lie within this share of each other are one change: one scale of all, or as much",
        "effect lost in another axis. A judgement.",
    )

    # -- what explains it: a sensor, a record or the aeroplane
    least_error: float = threshold(
        3.0,
        "Mean square error over the usual from which one cause is asked for: below it noise chooses the explanation.",
    )
    explained_time: float = threshold(4.0, "The newest time [s] whose errors it must explain. A judgement.")
    unexplained: float = threshold(
        0.5,
        "Share of the errors that an explanation leaves at most: delays that are no longer small leave 0.5, a wrong",
        "airspeed 0.4, a wrong record 0.0.",
    )
    unexplained_of_aeroplane: float = threshold(
        4.0,
        "Mean square error over the usual that a change of the aeroplane leaves at most: twice the usual error, as",
        "where a hold ends; noise on the records leaves 6.",
    )
    scale: float = threshold(
        0.15,
        "A scale that explains something is at least so far from one: parameters may be wrong by less, and errors that",
        "grow with the motion look like a scale.",
    )
    late: float = threshold(
        0.02, "A delay that explains something is at least so long [s]: in gusts the filter is late by less."
    )
    moved: float = threshold(
        0.02,
        "Chords by which a centre of gravity moves that is noticed: a fiftieth changes C_m,alpha by a tenth or more.",
    )
    farthest: float = threshold(0.25, "And by which it moves at most: beyond it nothing flies.")
    rough: float = threshold(
        0.0015, "Median third difference [rad] from which the record of a surface is noise. A judgement."
    )
    rougher: float = threshold(5.0, "And over what it was. A judgement.")
    rough_white: float = threshold(
        0.9, "And over the first difference: it is 1.2 to 1.6 of what a window has smoothed, 0.25 of a sine of 2 Hz."
    )
    rough_samples: int = threshold(25, "Samples that say so, before and lately. A judgement.")
    rough_time: float = threshold(4.0, "Lately is so long [s]. A judgement.")

    # -- how a hold begins and ends
    before_sign: float = threshold(
        4.0, "A sensor has been wrong for so long [s] before the first step says so. A judgement."
    )
    clear: float = threshold(5.0, "Time [s] without a sign after which sensors are sound. A judgement.")
    brief: float = threshold(
        3.0,
        "Signs that no axis felt and that last for less [s] do not make learning go back: a short contradiction spoils",
        "nothing. A judgement.",
    )
    settled: float = threshold(
        2.0, "Time [s] after the last sign from which samples are asked which values are right. A judgement."
    )
    evidence: int = threshold(
        50, "Samples of motion, two seconds, that say which of two sets of parameters is right. A judgement."
    )
    most_evidence: int = threshold(100, "And the most that are asked. A judgement.")
    decides: float = threshold(
        30.0, "Twice the log likelihood of one set of parameters over another that decides. A judgement."
    )
    long_evidence: int = threshold(
        250,
        "Samples of motion that are enough for newest values which predict ``worse`` times better than the old, but",
        "not as good as was usual: ten seconds. A judgement.",
    )
    confirmed: int = threshold(
        125,
        "Samples of motion that confirm that the aeroplane has changed, five seconds: two would let through faults",
        "that first show in one axis.",
    )
    sure: float = threshold(
        20.0,
        "Time [s] without a sign after which the newest values may stand after a sensor, and in which those of axes",
        "that were released together are tested again. A judgement.",
    )
    patience: float = threshold(
        30.0,
        "Time [s] for which axes that a sensor spoiled wait for each other, from when sensors are sound. A judgement.",
    )
    stuck: float = threshold(
        0.2, "Share of its effect below which a surface is taken for one that is stuck. A judgement."
    )
    stuck_known: float = threshold(
        0.25, "Standard error of what is left of its effect, over what it was, from which nothing is said. A judgement."
    )
    still: float = threshold(1e-6, "A record [rad] that moves by less stands still, to the last bit.")
    still_time: float = threshold(2.0, "For so long [s]. A judgement.")
    still_since: float = threshold(
        3.0, "If it stopped so near [s] to the first sign that something is wrong. A judgement."
    )
    unspoilt: float = threshold(
        5.0,
        "Time [s] for which nothing must have gone wrong after a checkpoint that outlives a change of the model. A",
        "judgement.",
    )

    # -- on the ground
    level: float = threshold(1.0, "Climb or descent [m/s] on the ground at most. A judgement.")
    stands: float = threshold(
        2.0,
        "It stands where it has been too slow to fly, and level, for so long [s]: at the top of a climb that ends in a",
        "stall it is so for less.",
    )
    landed: float = threshold(
        5.0, "It has landed where it has stood for so long [s], as in the diagnosis: a stall is shorter, and sinks."
    )
    rolling: float = threshold(
        20.0,
        "What is published then is from so long [s] before, as in the diagnosis: a jet that touches down at twice the",
        "least airspeed and slows down by 0.2 g needs as long. A judgement.",
    )
    flown: float = threshold(
        30.0,
        "Time [s] in flight, since the last landing, before there is another one: in wind one that stands may be as",
        "fast as one that flies, and what is shorter is a gust or a hop. A judgement.",
    )

    # -- sensors that no aircraft file describes
    vane_scale: float = threshold(
        0.06, "One sigma of the scale of a vane that nobody has described: upwash and position error. A judgement."
    )
    vane_lag: float = threshold(0.04, "One sigma of its lag [s]: tubes and logging. A judgement.")
    vane_seconds: float = threshold(
        5.0, "Time [s] of motion that must be summed before it says how a vane is. A judgement."
    )
    vane_aside: float = threshold(
        0.4,
        "One sigma of how far out on the wing a vane may be that nobody has placed, over the span, until the roll has",
        "shown it. A judgement.",
    )
    vane_aside_time: float = threshold(
        30.0,
        "The roll has shown it after so long [s]: the check in flight has looked by then, and what it finds holds all",
        "that uses the vane.",
    )
    vane_aside_rolls: float = threshold(4.0, "And after so many times the roll that shows it. A judgement.")
    correction: float = threshold(
        0.25,
        "One sigma of what a lag and a scale do to the parameters, over that: what filters make of a vane is not quite",
        "a lag. A judgement.",
    )
    motion_late: float = threshold(
        0.04,
        "One sigma of how late [s] motion is recorded after the surfaces: servos need 0.05 s, filters and loggers as",
        "much.",
    )
    motion_samples: float = threshold(
        125.0, "Samples of motion that must be summed before they say how late it is. A judgement."
    )
    motion_between: float = threshold(
        0.012,
        "One sigma of what happens [s] between samples at the lowest rate of the IMU; it goes with the square of the",
        "interval. A judgement, on a flight at 10 Hz that showed 16 ms and had none.",
    )
    motion_wrong: float = threshold(
        0.06,
        "One sigma of what no way of being late says, as a share: of a dead time of 20 ms and a lag of 60 ms, in",
        "gusts, 74 or 75 ms were found in each of three flights.",
    )
    command_between: float = threshold(0.005, "One sigma of when [s] a command moves between its samples. A judgement.")
    late_surely: float = threshold(3.0, "Standard errors from which surfaces are found to be late. A judgement.")
    late_least: float = threshold(
        0.005, "And the time [s] from which they are: 5 ms are a turn of some degrees at the quickest mode."
    )
    file_wrong_surely: float = threshold(
        3.0,
        "Standard errors from which a flight contradicts an aircraft file that says how late they are. A judgement.",
    )
    file_wrong_least: float = threshold(0.015, "And the time [s] from which it does. A judgement.")
    most_freed: float = threshold(
        0.75, "Share of a derivative that is put right for late surfaces at most: more is not believed. A judgement."
    )
    other_flight: float = threshold(
        15.0,
        "Time [s] for which what was learnt in another flight is not to be used, until this one has shown its sensors.",
        "A judgement.",
    )
    other_constant: float = threshold(0.02, "Least sigma of a constant until then, or its size. A judgement.")
    other_derivative: float = threshold(0.3, "And of a derivative, or its size. A judgement.")
    anew: float = threshold(
        0.02,
        "What the samples of before an axis was learnt anew count: nothing would leave the first seconds without any.",
    )

    # -- what earlier flights say
    prior_sigma: float = threshold(
        4.0, "Standard errors of both from which this flight and earlier ones contradict each other. A judgement."
    )
    prior_wider: float = threshold(
        2.5, "What those of this flight count for: in the first seconds of motion in gusts they are too small."
    )
    prior_looks: int = threshold(
        4,
        "Looks in a row, one per second, that must find it: in its first seconds of motion a flight is at times surer",
        "of itself than it should be.",
    )
    health_sigma: float = threshold(
        6.0,
        "Standard errors from which a fault of the aeroplane or of a sensor is said, beside earlier flights. A",
        "judgement.",
    )
    health_explains: float = threshold(0.6, "Share of all that is unusual that the fault must explain. A judgement.")
    health_looks: int = threshold(3, "Looks in a row, one per second. A judgement.")
    health_alike: float = threshold(
        12.0, "Another fault within so much of the best one in chi² may be it as well. A judgement."
    )
    health_fewest: int = threshold(
        4,
        "Parameters to USE, of those that a fault of the whole aeroplane moves, below which nothing is said of it. A",
        "judgement.",
    )
    health_airspeed: float = threshold(0.05, "Scale of the airspeed, less one, that matters. A judgement.")
    health_mass: float = threshold(0.08, "Share of the mass that matters. A judgement.")
    health_gravity: float = threshold(0.03, "Chords by which a centre of gravity moves that matter. A judgement.")
    health_power: float = threshold(0.15, "Share of its power that a surface loses or gains that matters. A judgement.")


THRESHOLDS = Thresholds()
