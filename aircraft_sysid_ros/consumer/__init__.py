"""For whoever flies on ``~/parameters``: consistent snapshots, last good values, fallback, blending.

Only ``subscriber`` knows ROS; everything else is numpy.
"""

from aircraft_sysid_ros.consumer.condition_table import ConditionTable
from aircraft_sysid_ros.consumer.snapshot import Condition, Snapshot, snapshot_of
from aircraft_sysid_ros.consumer.source import Answer, Origin, ParameterSource, Prior, Rules, Values, priors_of

__all__ = [
    "Answer",
    "Condition",
    "ConditionTable",
    "Origin",
    "ParameterSource",
    "Prior",
    "Rules",
    "Snapshot",
    "Values",
    "priors_of",
    "snapshot_of",
]
