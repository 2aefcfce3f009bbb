"""Many flights on a cluster of real workers: what happens to one happens to no other."""

from __future__ import annotations

import gc
import os
import signal
import threading

import pytest
from fake_flights import FakeJob, until, work

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.fleet.apart import Failed, Limits
from aircraft_sysid_ros.fleet.cluster import Work, cluster, fly_all


@pytest.mark.long
def test_the_rest_goes_on(tmp_path):
    """A crash, a hang and a worker that is killed in the middle: every other flight has its answer."""
    kinds = ["sound-1", "crash", "wait-1", "hang", "damaged", "sound-2", "sound-3"]
    jobs = [FakeJob(kind, tmp_path) for kind in kinds]
    found = {}

    def killer(pids):
        until((tmp_path / "wait-1").exists)
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        (tmp_path / "go").touch()

    with cluster(None, workers=2) as client:
        pids = list(client.run(os.getpid).values())
        thread = threading.Thread(target=killer, args=(pids,))
        thread.start()
        fly_all(client, jobs, Work(work), Limits(5.0), lambda job, outcome: found.update({job.key: outcome}))
        thread.join()
    failed = {key: outcome.sentence for key, outcome in found.items() if isinstance(outcome, Failed)}
    assert set(found) == set(kinds) and set(failed) == {"crash", "hang", "damaged"}
    assert failed["damaged"] == "the recording is damaged"
    assert "SIGSEGV" in failed["crash"] and "--time-limit" in failed["hang"]
    assert found["wait-1"]["number"] == 0.1 + 0.2


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:9", "nowhere", "tcp://", "http://127.0.0.1:9", "", "tcp://h:99999"]
)
@pytest.mark.filterwarnings("error")
def test_an_unknown_scheduler_is_one_sentence(address, monkeypatch):
    monkeypatch.setattr("aircraft_sysid_ros.fleet.cluster._PATIENCE", 0.3)
    with pytest.raises(InputError, match="no scheduler answers"), cluster(address):
        pass
    gc.collect()  # a client whose start failed would complain here
