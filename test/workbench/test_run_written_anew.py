"""A run that another program writes anew while its page is open: everything on the page is of the new flight."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from threading import Lock
from types import SimpleNamespace

import numpy as np
import pytest
from page_marks import marked, wait_for_text

from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.workbench.session import Session
from aircraft_sysid_ros.workbench.worker import LOAD, RECORD, Done, Job

RUDDER, RECEIVED, OTHER = 2, 1234, "other aeroplane"


@pytest.fixture
def without_rudder(hidden_effect, tmp_path):
    """The same flight whose rudder was not measured, so that three axes have no data."""
    shutil.copytree(hidden_effect, tmp_path / "anew")
    file = tmp_path / "anew" / "samples.npz"
    samples = dict(np.load(file))
    samples["values"][samples["kind"] == Kind.CONTROLS, RUDDER] = np.nan
    np.savez(file, **samples)
    state = json.loads((tmp_path / "anew" / "state.json").read_text())
    changed = {**state, "samples": {"airspeed": {"received": RECEIVED, "fused": 0, "rejected": 0}}}
    (tmp_path / "anew" / "state.json").write_text(json.dumps(changed))
    aircraft = (tmp_path / "anew" / "aircraft.yaml").read_text()
    (tmp_path / "anew" / "aircraft.yaml").write_text(re.sub("^name: .*$", f"name: {OTHER}", aircraft, flags=re.M))
    return tmp_path / "anew"


@pytest.mark.long
def test_every_view_is_of_the_flight_that_is_there_now(run, without_rudder, served, open_page) -> None:
    """State, the history of parameters and the name of the aircraft stayed those of the first flight, and the page
    stopped at the map."""
    with served(run) as address:  # no traceback
        page = open_page(address)
        for view in ("versions", "state", "model"):
            page.click(marked(f"tab-{view}"))
            page.wait_for_selector(marked({"versions": "history", "state": "consistency", "model": "map"}[view]))
        page.locator(".pickers .q-select").first.click()  # the axis of the map
        page.locator(".q-menu .q-item", has_text="rolling moment").click()
        whole = page.inner_text(marked("window"))
        page.locator(marked("places") + " button").first.click()
        page.wait_for_function("([s, t]) => document.querySelector(s).innerText !== t", arg=[marked("window"), whole])
        shutil.rmtree(run)
        without_rudder.rename(run)
        wait_for_text(page, "window", whole)
        page.wait_for_function(
            "() => !document.querySelector('.pickers .q-select').innerText.includes('rolling moment')"
        )
        assert page.inner_text(".who .name") == OTHER
        page.click(marked("tab-versions"))
        wait_for_text(page, "history", "–")
        page.click(marked("tab-state"))
        wait_for_text(page, "consistency", f"{RECEIVED:,}".replace(",", " "))
        page.close()  # before its server


@pytest.mark.parametrize("is_same", [True, False])
def test_what_came_of_work_on_another_flight_is_not_said_of_this_one(is_same) -> None:
    """That an effect is missing stood above a flight that was never diagnosed."""
    session, sent = object.__new__(Session), []
    session.view = SimpleNamespace(is_of_flight=lambda signature: is_same)
    session.path, session.calibration, session._pipe = Path("run"), object(), SimpleNamespace(send=sent.append)
    session.record, session.record_problem, session.damage, session.waiting = object(), "", "", None
    session.sentence, session.is_bad, session.revision, session._lock = "an effect is missing", True, 0, Lock()
    session._done(Done(Job(LOAD), view=SimpleNamespace(signature=())))
    assert (session.sentence, session.is_bad) == (("an effect is missing", True) if is_same else ("", False))
    assert [job.kind for job in sent] == ([] if is_same else [RECORD])
