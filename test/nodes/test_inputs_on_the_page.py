"""The live page knows the names of the inputs: the parameter node tells them, over real ROS 2."""

from __future__ import annotations

import pytest
import yaml

from aircraft_sysid_ros.nodes.common import start
from aircraft_sysid_ros.nodes.parameter_estimator import ParameterEstimatorNode
from aircraft_sysid_ros.workbench.live_session import LiveSession
from aircraft_sysid_ros.workbench.side_panels import complaint


@pytest.fixture
def page():
    session = LiveSession()
    yield session
    session.close()


def test_the_page_takes_terms_of_inputs_that_the_aircraft_file_of_the_node_names(bench, page, aircraft, tmp_path):
    source = {**aircraft.source, "inputs": {"trim_tab": {"unit": "deg"}, "spoiler": None}}
    (tmp_path / "aircraft.yaml").write_text(yaml.safe_dump(source, sort_keys=False))
    page.wait(60.0)
    assert "is not a signal" in complaint("Cm: trim_tab", page.flight.inputs)
    node = bench.node(ParameterEstimatorNode, aircraft_file=str(tmp_path / "aircraft.yaml"))
    before = page.revision
    assert start(node)
    bench.spin_until(lambda: page.flight.inputs == ("trim_tab", "spoiler"), 60.0)
    assert page.revision > before  # what is drawn is drawn anew
    assert not complaint("Cm: trim_tab", page.flight.inputs)
