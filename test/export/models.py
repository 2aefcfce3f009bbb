"""Other models on the rows of a run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aircraft_sysid_ros.aircraft.aerodynamic_model import model_from_terms
from aircraft_sysid_ros.export.learnt_model import LearntModel, Parameter


def with_terms(learnt, terms, reference=(0.0, 0.0, 0.0)):
    """The rows of a run under another model, whose parameters are drawn."""
    model = model_from_terms(terms)
    aircraft = replace(learnt.aircraft, model=model, aerodynamic_reference=np.array(reference))
    values = np.random.default_rng(1).uniform(-1.0, 1.0, len(model.parameter_names))
    listed = tuple(Parameter(n, float(v), 0.01, "USE") for n, v in zip(model.parameter_names, values, strict=True))
    return LearntModel(aircraft, "odd", listed, learnt.signals, learnt.step)
