"""Tables of docs/independent-truth.md."""

from __future__ import annotations

from results import load, table


def jsbsim_summary() -> str:
    """JSBSim aeroplanes: models and estimators against the projection, and on flights that were held out."""
    rows = []
    for name, a in load("jsbsim_truth")["aircraft"].items():
        models = [(f"32 terms, {estimator}", m) for estimator, m in a["textbook"].items()]
        for label, m in [*models, (f"{len(a['added']['parameters'])} terms, rls", a["added"])]:
            main = f"{100 * m['median_relative_error']:.1f} %" if "median_relative_error" in m else ""
            errors = [f"{100 * m['held_out'][x]:.1f} / {100 * m['held_out_projection'][x]:.1f}" for x in m["held_out"]]
            rows.append(
                [
                    name,
                    label,
                    f"{100 * m['within_3_sigma']:.1f} % of {m['pairs']}",
                    f"{100 * m['use_share']:.0f} %",
                    f"{100 * m['use_within_3_sigma']:.1f} %",
                    main,
                    *errors,
                ]
            )
    header = ["aeroplane", "model", "within 3 standard errors of (b)", "USE", "of those", "main derivatives",
              "CX", "CY", "CZ", "Cl", "Cm", "Cn"]  # fmt: skip
    return table(header, rows)


def jsbsim_parameters() -> str:
    """Main derivatives of the JSBSim aeroplanes: both truths and the estimate."""
    rows = []
    for name, a in load("jsbsim_truth")["aircraft"].items():
        found = a["textbook"]["rls"]["parameters"]
        for key in a["main_derivatives"]:
            p, (low, high) = found[key], a["local_range"][key]
            rows.append(
                [
                    name,
                    key,
                    f"{a['local'][key]:.4f}",
                    f"{low:.4f} to {high:.4f}",
                    f"{p['projection']:.4f}",
                    f"{p['value']:.4f} ± {p['std']:.4f}",
                    f"{100 * p['relative_error']:.1f} %",
                ]
            )
    header = ["aeroplane", "derivative", "(a) at trim", "(a) over the flown range", "(b)", "estimate ± standard error",
              "median distance to (b)"]  # fmt: skip
    return table(header, rows)


def jsbsim_added() -> str:
    """Terms beyond the 32, and what becomes of the pitching moment."""
    rows = []
    for name, a in load("jsbsim_truth")["aircraft"].items():
        textbook = a["textbook"]["rls"]["parameters"]
        for key, p in a["added"]["parameters"].items():
            if key not in textbook or key in ("Cm_alpha", "Cm_q"):
                rows.append(
                    [
                        name,
                        f"`{key}`",
                        f"{p['projection']:.3g}",
                        f"{p['value']:.3g} ± {p['std']:.2g}",
                        f"{100 * p['within_3_sigma']:.0f} %",
                        f"{100 * p['use']:.0f} %",
                    ]
                )
    return table(["aeroplane", "term", "(b)", "estimate ± standard error", "within 3", "USE"], rows)


TABLES = {
    "jsbsim_summary": jsbsim_summary,
    "jsbsim_parameters": jsbsim_parameters,
    "jsbsim_added": jsbsim_added,
}
