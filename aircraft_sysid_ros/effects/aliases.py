"""Effects of the library that differ by name only in a flight of some kind: their terms are then the same.

These sets follow from the formulas and not from what a diagnosis has said of any flight. In a flight it may find
more, by the correlation of what effects explain (``confounded_with``).
"""

from __future__ import annotations

#: Ids of a set, and why.
ALIASES: tuple[tuple[frozenset[str], str], ...] = (
    (
        frozenset({"control_damage", "stuck_control"}),
        "Both take a part of the answer to one surface away from one moment on. They differ by a constant moment, "
        "which is nil where a surface sticks near its trim.",
    ),
    (
        frozenset({"compressibility", "aeroelasticity"}),
        "At one height dynamic pressure is the square of the Mach number but for a factor, and so is, well below the "
        "speed of sound, 1/√(1 - M²) - 1.",
    ),
    (
        frozenset({"cg_shift", "parameter_change"}),
        "A shift along the fuselage adds a C_Z to C_m, which is a constant and a part in proportion to α: a change of "
        "C_m,0 and C_m,α, but for the small parts of C_Z that elevator and pitch rate make.",
    ),
    (
        frozenset({"mass_change", "parameter_change"}),
        "A wrong mass multiplies C_Z, which is a constant and a part in proportion to α: a change of C_Z,0 and C_Z,α. "
        "Only C_X and C_Y, which it multiplies too, show which it is.",
    ),
    (
        frozenset({"stall", "dynamic_stall"}),
        "Where the angle of attack is slow compared with the time of the flow, the flow is where it is in steady "
        "flight.",
    ),
    (
        frozenset({"stall", "lift_nonlinearity"}),
        "Of a wing that begins to stall and goes no further, lost lift has the shape of a cubic parabola, and a curved "
        "lift that of a gradual stall.",
    ),
    (
        frozenset({"flaps", "unrecorded_flaps"}),
        "The deflection of flaps that go out once and stay is a step, which needs no record.",
    ),
    (
        frozenset({"tow_line", "unrecorded_flaps"}),
        "At one airspeed the coefficient of a constant force is a constant.",
    ),
    (
        frozenset({"tow_line", "loss_of_thrust"}),
        "A thrust that stays as it is, as at full throttle, does not grow with dynamic pressure: what an engine no "
        "longer gives and what a line pulls back are the same in C_X.",
    ),
    (
        frozenset({"adverse_yaw", "control_effectiveness_alpha"}),
        "Both have α δ_a in C_n. Only what the ailerons do in C_l shows which it is.",
    ),
)


def aliases_of(identifier: str) -> frozenset[str]:
    """The other ids of the sets that an effect belongs to."""
    return frozenset().union(*(ids for ids, _ in ALIASES if identifier in ids)) - {identifier}
