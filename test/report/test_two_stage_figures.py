"""Figures of Tr R: one form for one, two and more unknowns."""

import numpy as np
import pytest

from aircraft_sysid_ros.estimation.two_stage.residual_sampling import ResidualSamples
from aircraft_sysid_ros.report.two_stage_figures import trace_figure


@pytest.mark.parametrize("n2", [1, 2, 5])
def test_the_samples_are_drawn_also_where_some_have_no_value(tmp_path, pictures, n2):
    xi2 = np.random.default_rng(0).uniform(-1.0, 1.0, (40, n2))
    trace = np.where(np.arange(40) % 7 == 0, np.inf, np.sum(xi2**2, axis=1))
    samples = ResidualSamples(xi2, np.zeros((40, 1)), trace, np.zeros(40, np.int64))
    names = tuple("abcde"[:n2])
    truth = np.full(n2, 0.1), 0.01
    path = trace_figure(samples, names, np.zeros(n2), tmp_path / "trace.png", "Tr R", reason="flat", truth=truth)
    assert path.read_bytes().startswith(b"\x89PNG") and path.stat().st_size > 5000
