"""What effects of the library are at full strength, as terms of the true aerodynamics.

Often with more physics than the formula of the library: soft onsets, saturation, McCormick's image vortices. Values are
shares of a derivative of the aeroplane where that is how one thinks of them, so that one recipe serves any aeroplane.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

STEP = "max(sign(time-{t0}),0)"


@dataclass(frozen=True)
class Term:
    """``C_axis += factor * coefficient * expression`` at full strength; without a coefficient the factor stands alone.

    {t0}, {span}, {chord} and drawn numbers may stand in the expression.
    """

    axis: str
    expression: str
    factor: float
    coefficient: str = ""


@dataclass(frozen=True)
class Recipe:
    """An effect at full strength. ``variants`` by name; ``plans``: flights in which it shows, one is drawn."""

    variants: Mapping[str, tuple[Term, ...]] = field(default_factory=dict)
    plans: tuple[str, ...] = ("standard", "varied", "speeds")
    inner: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # drawn between two limits


def _after(axis: str, expression: str, factor: float, coefficient: str = "") -> Term:
    return Term(axis, STEP if expression == "1" else f"{STEP}*{expression}", factor, coefficient)


def _loss(surface: str) -> str:
    """What a surface that saturates lacks, in rad: a quarter of its deflection at 6 degrees, a half at 10."""
    return f"(tanh(10*{surface})/10-{surface})"


_SEPARATED = "(0.5+0.5*tanh(14*(alpha-2*alpha_dot-{onset}-{trim_alpha})))"  # share of the wing; late while alpha grows
_ATTACHED = "lag(0.5-0.5*tanh(18*(alpha-1.5*alpha_dot-{onset}-{trim_alpha})),{lag})"
_LOST = f"(0.25*(1+sqrt({_ATTACHED}))**2-1)"  # of the lift, by Kirchhoff: from 0 to -3/4
_ICED = "(1-exp(-max(time-{t0},0)/{growth}))"
_LIFT = "(1/sqrt(max(1-mach**2,0.05))-1)"
_SLIP = ("varied", "sideslips")
_SPEEDS = ("speeds", "high_alpha")

RECIPES: dict[str, Recipe] = {
    "stall": Recipe(
        {
            "": (
                Term("CZ", f"{_SEPARATED}*alpha", -0.45, "CZ_alpha"),
                Term("CX", f"{_SEPARATED}*alpha", -0.6),
                Term("Cm", f"{_SEPARATED}*alpha", -0.35),
            )
        },
        ("high_alpha",),
        {"onset": (0.09, 0.13)},
    ),
    "dynamic_stall": Recipe(
        {
            "": (
                Term("CZ", f"{_LOST}*(alpha+0.05)", 0.7, "CZ_alpha"),
                Term("CX", f"{_LOST}*alpha", 0.6),
                Term("Cm", f"{_LOST}*alpha", 0.35),
            )
        },
        ("high_alpha",),
        {"onset": (0.09, 0.13), "lag": (0.2, 1.0)},
    ),
    "ground_effect": Recipe(
        {
            "": (
                Term("CZ", "exp(-3*max(height,0)/{span})*(alpha+0.03)", 0.3, "CZ_alpha"),
                Term("CX", "alpha**2/(1+(16*max(height,0)/{span})**2)", 1.6),
                Term("Cm", "exp(-3*max(height,0)/{span})*(alpha+0.03)", -0.1),
            )
        },
        ("low_passes",),
    ),
    "alpha_dot": Recipe(
        {"": (Term("Cm", "alpha_dot", 0.8, "Cm_q"), Term("CZ", "alpha_dot", 0.4, "CZ_q"))},
        ("standard", "varied"),
    ),
    "flaps": Recipe(
        {"": (Term("CZ", "flaps", -1.0), Term("CX", "flaps**2", -0.35), Term("CX", "flaps*alpha", 1.0),
              Term("Cm", "flaps", -0.12))},
        ("flaps",),
    ),
    "propwash": Recipe(
        {
            "": (
                Term("Cm", "Tc*de", 2.0, "Cm_de"), Term("CZ", "Tc*de", 2.0, "CZ_de"),
                Term("CZ", "Tc*alpha", 0.5, "CZ_alpha"), Term("Cn", "Tc*dr", 2.0, "Cn_dr"),
                Term("CY", "Tc*dr", 2.0, "CY_dr"),
            )
        },
        _SPEEDS,
    ),
    "thrust_offset": Recipe({"": (Term("Cm", "Tc", 0.25),)}),
    "propeller_torque": Recipe({"": (Term("Cl", "Tc", -0.04),)}),
    "propeller_gyroscopic": Recipe(
        {
            "": (
                Term("Cm", "propeller_speed*r*V/qbar", -2.0, "propeller"),
                Term("Cn", "propeller_speed*q*V/qbar", 1.0, "propeller"),
            )
        },
        _SPEEDS,
    ),
    "compressibility": Recipe(
        {
            "": (
                Term("CZ", f"{_LIFT}*alpha", 1.0, "CZ_alpha"), Term("CZ", f"{_LIFT}*de", 1.0, "CZ_de"),
                Term("Cm", f"{_LIFT}*alpha", 1.5, "Cm_alpha"), Term("Cm", f"{_LIFT}*de", 1.0, "Cm_de"),
                Term("CX", "max(mach-0.6,0)**2", -0.8),
            )
        },
        ("speeds",),
    ),
    "adverse_yaw": Recipe({"": (Term("Cn", "alpha*da", 0.5),)}, (*_SPEEDS, "varied")),
    "dihedral_alpha": Recipe({"": (Term("Cl", "alpha*beta", -0.7),)}, (*_SPEEDS, "sideslips")),
    "sideslip_drag": Recipe({"": (Term("CX", "1-sqrt(1+200*beta**2)", 0.02),)}, _SLIP),
    "sideslip_pitching": Recipe({"": (Term("Cm", "beta**2", -0.7),)}, _SLIP),
    "control_nonlinearity": Recipe(
        {
            "elevator": (Term("Cm", _loss("(de-{trim_de})"), 1.0, "Cm_de"),
                         Term("CZ", _loss("(de-{trim_de})"), 1.0, "CZ_de")),
            "aileron": (Term("Cl", _loss("da"), 1.0, "Cl_da"), Term("Cn", _loss("da"), 1.0, "Cn_da")),
        },
        ("standard", "varied", "high_alpha"),
    ),
    "free_play": Recipe(
        {
            "elevator": (Term("Cm", "{gap}*tanh((de-{trim_de})/{gap})", -1.0, "Cm_de"),
                         Term("CZ", "{gap}*tanh((de-{trim_de})/{gap})", -1.0, "CZ_de")),
            "aileron": (Term("Cl", "{gap}*tanh(da/{gap})", -1.0, "Cl_da"),
                        Term("Cn", "{gap}*tanh(da/{gap})", -1.0, "Cn_da")),
        },
        inner={"gap": (0.02, 0.04)},
    ),
    "rate_limit": Recipe(
        {
            "elevator": (Term("Cm", "limited(de,{rate})-de", 1.0, "Cm_de"),
                         Term("CZ", "limited(de,{rate})-de", 1.0, "CZ_de")),
            "aileron": (Term("Cl", "limited(da,{rate})-da", 1.0, "Cl_da"),
                        Term("Cn", "limited(da,{rate})-da", 1.0, "Cn_da")),
        },
        inner={"rate": (0.12, 0.3)},
    ),
    "control_effectiveness_alpha": Recipe(
        {
            "elevator": (Term("Cm", "alpha*de", -2.5, "Cm_de"), Term("CZ", "alpha*de", -2.5, "CZ_de")),
            "aileron": (Term("Cl", "alpha*da", -2.5, "Cl_da"),),
        },
        _SPEEDS,
    ),
    "asymmetric_thrust": Recipe({"": (Term("Cn", "Tc", 0.03),)}),
    "loss_of_thrust": Recipe(
        {
            "": (_after("CX", "Tc", -1.0, "CX_Tc"),),
            "with drag of the propeller": (_after("CX", "Tc", -1.0, "CX_Tc"), _after("CX", "1", -0.012)),
        }
    ),
    "landing_gear": Recipe({"": (_after("CX", "1", -0.025), _after("Cm", "1", -0.02), _after("CX", "alpha", 0.05))}),
    "unrecorded_flaps": Recipe(
        {"": (_after("CZ", "1", -0.2), _after("CZ", "alpha", 0.1, "CZ_alpha"), _after("CX", "1", -0.015),
              _after("CX", "alpha", 0.15), _after("Cm", "1", -0.03))}
    ),
    "tow_line": Recipe(
        {"": (_after("CX", "({qbar}/qbar)", -0.025), _after("CZ", "({qbar}/qbar)", 0.03),
              _after("Cm", "({qbar}/qbar)", 0.015))},
        ("speeds",),
    ),
    "icing": Recipe(
        {
            "": (
                Term("CX", _ICED, -0.025), Term("CX", f"{_ICED}*alpha**2", -0.8),
                Term("CZ", f"{_ICED}*alpha", -0.18, "CZ_alpha"), Term("CZ", f"{_ICED}*de", -0.1, "CZ_de"),
                Term("Cm", f"{_ICED}*de", -0.1, "Cm_de"), Term("Cm", f"{_ICED}*alpha", -0.1, "Cm_alpha"),
            )
        },
        inner={"growth": (15.0, 40.0)},
    ),
    "lift_nonlinearity": Recipe(
        {"": (Term("CZ", "alpha*abs(alpha)", -10.0), Term("Cm", "alpha*abs(alpha)", -3.0))},
        ("standard", *_SPEEDS),
    ),
    "lift_tilt": Recipe(
        {"": (Term("CX", "alpha*de", -1.0, "CZ_de"), Term("CX", "alpha*q", -1.0, "CZ_q"))}, ("standard", *_SPEEDS)
    ),
    "lateral_rates_alpha": Recipe(
        {"": (Term("Cl", "alpha*r", 1.5), Term("Cn", "alpha*p", -1.0))}, (*_SPEEDS, "varied")
    ),
    "p_factor": Recipe({"": (Term("Cn", "Tc*alpha", 0.35), Term("Cm", "Tc*beta", 0.6))}, _SPEEDS),
    "aeroelasticity": Recipe(
        {
            "tail": (Term("Cm", "(1/(1+0.5*qbar/{qbar})-0.667)*de", 2.0, "Cm_de"),),
            "wing and ailerons": (Term("Cl", "(1/(1+0.5*qbar/{qbar})-0.667)*da", 2.0, "Cl_da"),),
        },
        ("speeds",),
    ),
    "control_damage": Recipe(
        {
            "elevator": (_after("Cm", "de", -0.4, "Cm_de"), _after("CZ", "de", -0.4, "CZ_de"),
                         _after("Cl", "de", 0.03, "Cm_de")),
            "aileron": (_after("Cl", "da", -0.4, "Cl_da"), _after("Cn", "da", -0.4, "Cn_da")),
            "rudder": (_after("Cn", "dr", -0.5, "Cn_dr"), _after("CY", "dr", -0.5, "CY_dr")),
        }
    ),
    "stuck_control": Recipe(
        {
            "elevator": (_after("Cm", "(de-{stuck}-{trim_de})", -0.5, "Cm_de"),
                         _after("CZ", "(de-{stuck}-{trim_de})", -0.5, "CZ_de")),
            "aileron": (_after("Cl", "(da-{stuck})", -0.5, "Cl_da"), _after("Cn", "(da-{stuck})", -0.5, "Cn_da")),
            "rudder": (_after("Cn", "(dr-{stuck})", -0.6, "Cn_dr"), _after("CY", "(dr-{stuck})", -0.6, "CY_dr")),
        },
        inner={"stuck": (0.02, 0.06)},
    ),
    "parameter_change": Recipe(
        {
            "pitch stiffness": (_after("Cm", "alpha", -0.35, "Cm_alpha"),),
            "yaw stiffness": (_after("Cn", "beta", -0.35, "Cn_beta"), _after("CY", "beta", -0.2, "CY_beta")),
            "roll damping": (_after("Cl", "p", -0.3, "Cl_p"),),
            "lift slope": (_after("CZ", "alpha", -0.2, "CZ_alpha"),),
        }
    ),
    "propeller_thrust": Recipe({"": (Term("CX", "throttle/qbar", 10.0), Term("CX", "throttle/V", -0.7))}, _SPEEDS),
}  # fmt: skip
