"""Effects that begin during a flight: damage, failures, what goes out or is hooked on, mass and where its centre is."""

from __future__ import annotations

from dataclasses import replace

from aircraft_sysid_ros.effects.effect import (
    BEGIN,
    CHANGE,
    CHORD_BY_SPAN,
    LONGITUDINAL,
    STEP,
    Effect,
    Tie,
    Variant,
    surface,
)

_TIME_OF_CHANGE = (BEGIN,)


def _after(*terms: str) -> tuple[str, ...]:
    """Terms from the time of the change on."""
    return tuple(STEP if term == "1" else f"{STEP}*{term}" for term in terms)


def _fin() -> Variant:
    """A part of the fin and of its rudder: what the rudder, sideslip and yaw make there has one place and one arm."""
    terms = _after("dr", "beta", "r")
    ties = {axis: tuple(Tie(k, of=f"{axis}_dr") for k in range(len(terms))) for axis in ("Cn", "CY")}
    return Variant("fin with its rudder", dict.fromkeys(ties, terms), ties=ties)


def _half_elevator(*terms: str) -> Variant:
    """One of two halves, on one side."""
    return replace(surface("elevator", ("Cm", "CZ"), _after(*terms), besides=("Cl",)), name="one half of the elevator")


def _one_aileron(*terms: str) -> Variant:
    """One of two: the other one alone lifts, too."""
    return replace(surface("aileron", ("Cl", "Cn"), _after(*terms), besides=("CZ", "Cm")), name="one of two ailerons")


def _same_share(step: str) -> Variant:
    """One number for the three forces."""
    axes = ("CX", "CY", "CZ")
    return Variant(terms={a: (f"{step}*{{{a}}}",) for a in axes}, ties={a: (Tie(0),) for a in axes})


EFFECTS: tuple[Effect, ...] = (
    Effect(
        "control_damage",
        "Damage of a control surface",
        CHANGE,
        "A surface that lost a part of its area, or one of two halves, answers less from one moment on. What is lost "
        "on one side makes a moment about the other axes too.",
        "R. Jategaonkar, Flight Vehicle System Identification; M. Steinberg, Historical Overview of Research in "
        "Reconfigurable Flight Control, Proc. IMechE G 219, 2005",
        "C += a C_δ δ for t > t₀, with one share a in the axes of the surface; C_l of rudder or half elevator, C_Z and "
        "C_m of one aileron: another",
        (
            surface("elevator", ("Cm", "CZ"), _after("de")),
            _half_elevator("de"),
            surface("aileron", ("Cl", "Cn"), _after("da")),
            _one_aileron("da"),
            surface("rudder", ("Cn", "CY"), _after("dr"), besides=("Cl",)),
        ),
        "Good before one moment, afterwards errors in phase with one surface.",
        "Doublets of every surface, repeated during the flight.",
        _TIME_OF_CHANGE,
        share_sign=-1.0,
    ),
    Effect(
        "stuck_control",
        "Stuck control surface",
        CHANGE,
        "A surface that stays where it was no longer follows the recorded command, or one of two halves does not. Its "
        "part of the moment is then a constant instead of one in proportion to the command.",
        "M. Steinberg, Historical Overview of Research in Reconfigurable Flight Control, Proc. IMechE G 219, 2005; "
        "B. Stevens, F. Lewis and E. Johnson, Aircraft Control and Simulation",
        "C += C_δ (a δ + b) for t > t₀, a and b shared as the share of a damage; it stuck at -b / a",
        (
            surface("elevator", ("Cm", "CZ"), _after("de", "1")),
            _half_elevator("de", "1"),
            surface("aileron", ("Cl", "Cn"), _after("da", "1")),
            _one_aileron("da", "1"),
            surface("rudder", ("Cn", "CY"), _after("dr", "1"), besides=("Cl",)),
        ),
        "As of damage, with a constant moment from the same time on.",
        "Doublets of every surface, repeated during the flight.",
        _TIME_OF_CHANGE,
        share_sign=-1.0,
    ),
    Effect(
        "parameter_change",
        "Change of a derivative",
        CHANGE,
        "Damage of wing, tail or fin, or a part that came loose, changes how stable or damped the aeroplane is from "
        "one moment on. The controls work as before, but for the rudder of a fin that lost a part of its height.",
        "V. Klein and E. Morelli, Aircraft System Identification; R. Jategaonkar, Flight Vehicle System Identification",
        "C += a x + b for t > t₀, with x the variable of the derivative; of a fin C_n, C_Y += (C_n,δr, C_Y,δr) "
        "(a δ_r + b β + c r)",
        (
            Variant("pitch stiffness", {"Cm": _after("alpha", "1")}),
            Variant("pitch damping", {"Cm": _after("q")}),
            Variant("lift slope", {"CZ": _after("alpha", "1")}),
            Variant("yaw stiffness", {"Cn": _after("beta"), "CY": _after("beta")}),
            Variant("roll damping", {"Cl": _after("p")}),
            Variant("dihedral", {"Cl": _after("beta")}),
            Variant("yaw damping", {"Cn": _after("r")}),
            _fin(),
        ),
        "Good before one moment, afterwards errors of one axis in phase with one variable of the motion.",
        "Excitation of all axes, repeated during the flight.",
        _TIME_OF_CHANGE,
    ),
    Effect(
        "mass_change",
        "Change of mass",
        CHANGE,
        "Coefficients of force are mass times specific force, so that with a wrong mass all three are wrong by the "
        "same factor. A load or water that is dropped makes it so at once, what burns or runs out little by little.",
        "V. Klein and E. Morelli, Aircraft System Identification; (6.14)-(6.18) of docs/references.md",
        "C_X, C_Y, C_Z += a C_X, a C_Y, a C_Z for t > t₀, with one a = m_file / m - 1 for the three",
        (_same_share(STEP),),
        "From one moment on C_X, C_Y and C_Z are wrong by the same factor; moments too, as inertia changed.",
        "Any, before and after the change; throttle steps tell it from icing.",
        _TIME_OF_CHANGE,
        takes_time=True,
    ),
    Effect(
        "cg_shift",
        "Shift of the centre of gravity",
        CHANGE,
        "Forces act about the centre of gravity: when it moves by d, the moments change by d × F. A shift along the "
        "fuselage changes static stability and trim, one along the wing rolls the aeroplane with its lift.",
        "B. Etkin and L. Reid, Dynamics of Flight; W. Phillips, Mechanics of Flight",
        "C_m += a C_Z, C_n += -a c/b C_Y (along); C_l += a C_Z, C_n += -a C_X (across), for t > t₀",
        (
            Variant(
                "along the fuselage",
                {"Cm": _after("{CZ}"), "Cn": _after("{CY}")},
                ties={"Cm": (Tie(0),), "Cn": (Tie(0, -1.0, CHORD_BY_SPAN),)},
            ),
            Variant(
                "along the wing",
                {"Cl": _after("{CZ}"), "Cn": _after("{CX}")},
                ties={"Cl": (Tie(0),), "Cn": (Tie(0, -1.0),)},
            ),
        ),
        "From one moment on C_m is wrong in proportion to lift, C_n to side force.",
        "Pull-ups and sideslips before and after.",
        _TIME_OF_CHANGE,
        takes_time=True,
    ),
    Effect(
        "loss_of_thrust",
        "Loss of thrust",
        CHANGE,
        "An engine that stops no longer pulls, whatever was asked of it, so that what thrust did along the body is "
        "gone from one moment on. A propeller that stands or windmills is drag besides.",
        "B. McCormick, Aerodynamics, Aeronautics and Flight Mechanics; W. Phillips, Mechanics of Flight",
        "C_X += a T_c, or a T_c + b, for t > t₀; a = -C_X,Tc where all thrust is lost",
        (
            Variant(terms={"CX": _after("Tc")}),
            Variant("with drag of the propeller", {"CX": _after("Tc", "1")}),
        ),
        "From one moment on C_X is wrong in proportion to the thrust that is recorded; none of C_Z.",
        "Throttle steps at constant speed, before and after.",
        _TIME_OF_CHANGE,
    ),
    Effect(
        "unrecorded_flaps",
        "Flaps, slats or spoilers that are not recorded",
        CHANGE,
        "A wing whose flaps, slats or spoilers go out has another camber from one moment on, which nothing in the "
        "recording shows. At the same angle of attack lift, drag and pitching moment have other constants.",
        "J. Roskam, Airplane Design, part VI; B. McCormick, Aerodynamics, Aeronautics and Flight Mechanics",
        "C_Z, C_X, C_m += a for t > t₀, with a number for each axis",
        (Variant(terms={axis: _after("1") for axis in LONGITUDINAL}),),
        "From some time on constant errors of C_Z, C_X and C_m.",
        "Flaps out and in at constant speed, recorded.",
        _TIME_OF_CHANGE,
    ),
    Effect(
        "tow_line",
        "Tow line, tether or load on a line",
        CHANGE,
        "A line that is hooked on or dropped pulls with a force of its own, which does not grow with dynamic "
        "pressure as those of the air do. Where it is attached away from the centre of gravity it makes a pitching "
        "moment as well.",
        "B. Etkin and L. Reid, Dynamics of Flight; W. Phillips, Mechanics of Flight",
        "C_X, C_Z, C_m += a / q̄ for t > t₀, or for t < t₀, with a number for each axis",
        (
            Variant("hooked on", {axis: _after("(1/qbar)") for axis in LONGITUDINAL}),
            Variant("dropped", {axis: (f"(1-{STEP})*(1/qbar)",) for axis in LONGITUDINAL}),
        ),
        "From some time on, or until then, errors of C_X, C_Z and C_m that are larger the slower it flies.",
        "Two speeds before and after the line is hooked on or dropped.",
        _TIME_OF_CHANGE,
        rare=True,
    ),
    Effect(
        "fuel_burn",
        "Mass that falls with time",
        CHANGE,
        "An aeroplane that burns fuel gets lighter, so that coefficients worked out with the mass of the file grow "
        "wrong by the same share in all three forces. It begins at the start and is steady.",
        "(6.14)-(6.18) of docs/references.md; V. Klein and E. Morelli, Aircraft System Identification",
        "C_X, C_Y, C_Z += a t C_X, a t C_Y, a t C_Z, with one a for the three",
        (_same_share("time"),),
        "Errors of C_X, C_Y and C_Z that grow in proportion to time and to the coefficient.",
        "The same manoeuvres at the beginning and at the end.",
    ),
)
