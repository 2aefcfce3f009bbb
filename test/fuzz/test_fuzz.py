"""Every target of the fuzz harness for a moment, always with the same inputs; ``make fuzz`` is for long."""

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from targets import TARGETS

QUICK = settings(
    deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck), phases=[Phase.generate]
)


@pytest.mark.long_after_the_first
@pytest.mark.parametrize("name", TARGETS)
def test_nothing_but_a_sentence_comes_of_what_others_write(name):
    found = TARGETS[name]

    @settings(QUICK, max_examples=found.tried)
    @given(found.inputs())
    def tried(item):
        found.run(item)

    tried()
