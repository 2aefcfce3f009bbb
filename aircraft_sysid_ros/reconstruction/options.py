"""Options of the first step."""

from __future__ import annotations

from aircraft_sysid_ros.option import option, options

#: No option lets either step wait longer [s] for samples that come late.
LONGEST_WAIT = 5.0


@options
class StateOptions:
    """Options of the first step; the live node offers them as parameters."""

    horizon: float = option(
        0.5, "How late a sample may arrive and still be fused at its own time.", "s", 0.0, LONGEST_WAIT
    )
    #: Of a scalar innovation; more outputs at the same probability.
    gate: float = option(5.0, "Innovations larger than this are rejected.", "sigma", 2.0, 100.0)
    maximum_iterations: int = option(5, "Largest number of iterations of one measurement update.", "", 1, 50)
    #: Of (3.16).
    tolerance: float = option(
        1e-3, "The update has converged when it changes the state by less than this.", "sigma", 1e-9, 1.0
    )
    maximum_gap: float = option(
        0.5, "Longest gap in the IMU that is integrated; after a longer one the filter is realigned.", "s", 0.05, 5.0
    )
    divergence_time: float = option(
        5.0, "Realign when GPS has been rejected without a break for this long.", "s", 1.0, 60.0
    )
    calm_air: bool = option(
        False,
        "Assume calm air: if airspeed is not measured, the ground speed is used in its place.",
        fixed="the state begins with it",
    )
    air_data_errors: bool = option(
        False,
        "Estimate scale and offset of airspeed, alpha and beta as filter states, starting from the calibration.",
        fixed="they are states of the filter",
    )
