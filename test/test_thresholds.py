"""The records of what decides: each threshold has a reason, and none stands there for nothing."""

import ast
from pathlib import Path

import pytest

import aircraft_sysid_ros
from aircraft_sysid_ros.diagnosis import thresholds as diagnosis
from aircraft_sysid_ros.identification import thresholds as identification
from aircraft_sysid_ros.threshold import thresholds_of

RECORDS = [diagnosis, identification]
FILES = sorted(Path(aircraft_sysid_ros.__file__).parent.rglob("*.py"))


def used(record: str) -> set[str]:
    """Attributes of THRESHOLDS in the files that import it from a module."""
    found = set()
    for path in FILES:
        text = path.read_text(encoding="utf8")
        if f"from {record} import THRESHOLDS\n" in text:
            found |= {
                node.attr
                for node in ast.walk(ast.parse(text))
                if isinstance(node, ast.Attribute)
                and isinstance(node.value, ast.Name)
                and node.value.id == "THRESHOLDS"
            }
    return found


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.__name__)
def test_every_threshold_says_what_it_is_and_why(record):
    reasons = {name: why for name, _, why in thresholds_of(record.THRESHOLDS)}
    assert len(reasons) > 50
    assert [name for name, why in reasons.items() if len(why.split()) < 5 or not why.endswith(".")] == []


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.__name__)
def test_every_threshold_is_used(record):
    assert {name for name, _, _ in thresholds_of(record.THRESHOLDS)} == used(record.__name__)
