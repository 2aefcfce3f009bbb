"""Frequency responses of the rates to the deflections: magnitude, phase and coherence, without a model."""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.aircraft.signals import CONTROL_WORDS
from aircraft_sysid_ros.diagnosis.frequency_responses import COHERENT, RateResponse
from aircraft_sysid_ros.workbench.views.figure import Figure, Theme, axis, encoded, figure, line

WORDS = (
    "Angular rates to deflections, each with the others held, from the flight alone. Bold, with two standard errors, "
    f"where the coherence is {COHERENT:g} or more; elsewhere the rate does not follow the deflection."
)
_TICKS = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0]
#: From the bottom: coherence, phase, magnitude.
_DOMAINS = ([0.0, 0.2], [0.27, 0.55], [0.62, 1.0])


def title(found: RateResponse) -> str:
    """What answers to what."""
    return f"{found.rate} to {CONTROL_WORDS.get(found.control, found.control)}"


def response_figure(found: RateResponse, theme: Theme, height: int = 420) -> Figure:
    """Three plots over one frequency; markers, so that a single coherent frequency is seen, too."""
    size, phase = np.abs(found.response), np.degrees(np.unwrap(np.angle(found.response)))
    coherent = np.nan_to_num(found.coherence) >= COHERENT
    if coherent.any():  # near zero, where it counts
        phase -= 360.0 * np.round(np.median(phase[coherent]) / 360.0)
    shown = {"magnitude": (size, 2.0 * size * found.std, "y3"), "phase": (phase, 2.0 * np.degrees(found.std), "y2")}
    data = []
    for name, (values, error, place) in shown.items():
        on = {"xaxis": "x", "yaxis": place}
        data.append(line(found.frequency, values, theme.noise, f"{name}, all of it", width=0.8, hoverinfo="skip", **on))
        data.append({
            "type": "scatter", "mode": "lines+markers", "name": name, "connectgaps": False, **on,
            "x": encoded(found.frequency), "y": encoded(np.where(coherent, values, np.nan)),
            "error_y": {"type": "data", "array": encoded(error), "thickness": 1, "width": 0, "color": theme.residual},
            "line": {"color": theme.residual, "width": 2}, "marker": {"size": 4, "color": theme.residual},
        })  # fmt: skip
    ends = found.frequency[[0, -1]]
    data.append(line(found.frequency, found.coherence, theme.residual, "coherence", width=1.6, xaxis="x", yaxis="y"))
    least = line(ends, np.full(2, COHERENT), theme.noise, "least coherence", dash="dot", hoverinfo="skip")
    data.append({**least, "xaxis": "x", "yaxis": "y"})
    low, high = (np.log10(ends) + (-0.02, 0.02)).tolist()
    known = size[size > 0.0]
    sizes = (np.log10(np.quantile(known, (0.02, 0.98))) + (-0.2, 0.2)).tolist() if len(known) else [-1.0, 1.0]
    powers = 10.0 ** np.arange(np.floor(sizes[0]), np.ceil(sizes[1]))
    steps = [m * power for power in powers for m in ((1.0, 2.0, 5.0) if len(powers) < 4 else (1.0,))]
    return figure(
        theme, data, height,
        xaxis=axis(theme, "frequency [Hz]", type="log", range=[low, high], fixedrange=True, tickvals=_TICKS,
                   ticktext=[f"{tick:g}" for tick in _TICKS], anchor="y"),
        yaxis=axis(theme, "coherence [-]", range=[0.0, 1.05], fixedrange=True, nticks=3, domain=_DOMAINS[0]),
        yaxis2=axis(theme, "phase [deg]", fixedrange=True, nticks=5, domain=_DOMAINS[1]),
        yaxis3=axis(theme, "magnitude [1/s]", type="log", fixedrange=True, domain=_DOMAINS[2], range=sizes,
                    tickvals=steps, ticktext=[f"{step:g}" for step in steps]),
    )  # fmt: skip
