"""A browser whose connection was lost for a moment shows what is so now, nothing of what it missed meanwhile."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from counting_link import LAST
from page_marks import marked, wait_for_text

from aircraft_sysid_ros.workbench import frame

#: The browser has not yet said what it has got,
NOTHING_SAID = "window.ackedMessageId = Infinity"
#: and the connection breaks with the last messages on their way: it asks for them again when it is back.
LOSE = "window.socket.disconnect(); window.nextMessageId -= 4;"
COME_BACK = "window.socket.io.opts.query.next_message_id = window.nextMessageId; window.socket.connect()"


@pytest.mark.long
def test_numbers_of_a_browser_that_was_away_are_those_of_now(served, open_page) -> None:
    with served("--live", program=(Path(__file__).with_name("counting_link.py"),)) as address:
        away, stays = open_page(address), open_page(address)
        for page in (away, stays):
            wait_for_text(page, "held-out-Cl", "%")
        away.evaluate(NOTHING_SAID)
        away.wait_for_timeout(3000)
        away.evaluate(LOSE)
        wait_for_text(stays, "held-out-Cl", f"{LAST}.0 %")
        away.evaluate(COME_BACK)
        wait_for_text(away, "error-Cl", f"{LAST}.0 %")
        away.wait_for_timeout(1000)
        assert away.inner_text(marked("held-out-Cl")) == f"{LAST}.0 %"
        for page in (away, stays):
            page.context.close()


def test_a_browser_that_has_gone_before_it_could_say_how_it_looks_is_no_error(monkeypatch):
    """Its time ran out, and the terminal had a traceback."""

    async def silent(*_, **__):
        raise TimeoutError

    monkeypatch.setattr(frame.ui, "run_javascript", silent)
    page = SimpleNamespace(look=SimpleNamespace(theme=frame.LIGHT))
    with pytest.raises(StopIteration):  # it ends; a loop of the browser is running
        frame.Frame._adopt_theme(page).send(None)
    assert page.look.theme is frame.LIGHT
