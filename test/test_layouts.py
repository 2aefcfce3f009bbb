"""The layouts of Foxglove and PlotJuggler draw topics and fields that the message definitions have, and no others."""

import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from aircraft_sysid_ros.recordings.message_definitions import message_definitions
from aircraft_sysid_ros.ros_messages.topics import DIAGNOSTICS, OUTPUTS

CONFIG = Path(__file__).resolve().parents[1] / "config"
TYPES = {f"/{topic.name.lstrip('/')}": topic.type for listed in OUTPUTS.values() for topic in (*listed, DIAGNOSTICS)}
BASE, NAME, ARRAY, SEQUENCE = 1, 2, 3, 4  # kinds of fields in rosbags


@pytest.fixture(scope="module")
def store():
    made = get_typestore(Stores.ROS2_JAZZY)
    types = {}
    for name, text in message_definitions().items():
        types.update(get_types_from_msg(text, name))
    made.register(types)
    return made


def check(store, path):
    """A path such as /node/topic.axes[:]{axis=="CX"}.measured or /node/topic/axes[0]/measured leads to something."""
    topic = next(
        (t for t in sorted(TYPES, key=len, reverse=True) if path == t or path.startswith((f"{t}.", f"{t}/"))), None
    )
    assert topic, f"no node publishes what {path} draws"
    kind, words = TYPES[topic], re.findall(r"(\w+)((?:\[[^]]*\]|\{[^}]*\})*)", path[len(topic) + 1 :])
    for place, (word, index) in enumerate(words):
        fields = dict(store.fielddefs[kind][1])
        assert word in fields, f"{path}: {kind} has no {word}"
        node, content = fields[word]
        is_many = int(node) in (ARRAY, SEQUENCE)
        last = place == len(words) - 1
        assert is_many or not index, f"{path}: {word} is one value"
        inner, inner_content = (content[0][0], content[0][1]) if is_many else (node, content)
        if int(inner) == NAME:
            for chosen in re.findall(r"\{(\w+)==", index):
                assert chosen in dict(store.fielddefs[inner_content][1]), path
            kind = inner_content
        else:
            assert last, f"{path}: {word} has no parts"


def foxglove():
    layout = json.loads((CONFIG / "foxglove_layout.json").read_text(encoding="utf8"))
    for panel, config in layout["configById"].items():
        yield from (each["value"] for each in config.get("paths", ()))
        yield from (config[key] for key in ("topicPath", "topicToRender") if key in config)
        assert panel.split("!")[0] in ("Plot", "RawMessages", "DiagnosticSummary", "Tab")


def plotjuggler():
    root = ElementTree.parse(CONFIG / "plotjuggler_layout.xml").getroot()
    return [curve.get("name") for curve in root.iter("curve")]


@pytest.mark.parametrize("drawn", [foxglove, plotjuggler])
def test_all_that_is_drawn_exists(store, drawn):
    paths = list(drawn())
    assert len(paths) > 25
    for path in paths:
        check(store, path)


@pytest.mark.parametrize(
    "path",
    [
        "/state_estimator/nothing.x", "/state_estimator/state.wind", "/state_estimator/state/euler[0]/x",
        "/parameter_estimator/model_error.axes[:]{name==\"CX\"}.nrmse", "/state_estimator/state.true_airspeed[0]",
    ],
)  # fmt: skip
def test_what_does_not_exist_is_found(store, path):
    with pytest.raises(AssertionError):
        check(store, path)


def test_every_panel_stands_in_a_tab_and_every_tab_holds_panels():
    layout = json.loads((CONFIG / "foxglove_layout.json").read_text(encoding="utf8"))
    panels = set(layout["configById"]) - {layout["layout"]}
    placed = set(re.findall(r'"(\w+!\w+)"', json.dumps(layout["configById"][layout["layout"]])))
    assert placed == panels
