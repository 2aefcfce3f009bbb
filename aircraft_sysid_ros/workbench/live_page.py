"""The page of a flight in progress: it shows what a parameter node says, and asks it."""

from __future__ import annotations

from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.frame import POINT, Frame
from aircraft_sysid_ros.workbench.live_panels import (
    LiveModelPanel,
    LivePanel,
    LiveParametersPanel,
    LiveStatePanel,
    added_words,
)
from aircraft_sysid_ros.workbench.panel import Panel
from aircraft_sysid_ros.workbench.views.live import presence_sentence
from aircraft_sysid_ros.workbench.worker import ADD


class LivePage(Frame):
    """One browser's page of a running node."""

    @property
    def name(self) -> str:
        """The node."""
        return f"In flight: {self.session.node}"

    def views(self) -> dict[str, Panel]:
        """What a node says."""
        self._allowed: bool | None = None
        return {"Model": LiveModelPanel(self), "Parameters": LiveParametersPanel(self), "State": LiveStatePanel(self)}

    @property
    def allowed(self) -> bool:
        """Whether the node can be asked for a change now."""
        return self.session.flight.is_there and self.session.job is None

    def help(self) -> dict[str, str]:
        """Its time plots slide by themselves."""
        return {**POINT, **super().help()}

    def follow(self) -> None:
        """Show what the session holds now; of the views only the one that is looked at."""
        self._facts()
        self._say()
        panel = self.panels[self.tabs.value or "Model"]
        if isinstance(panel, LivePanel):
            panel.follow()
        if self.allowed != self._allowed:
            self._allowed = self.allowed
            self.allow()

    def _facts(self) -> None:
        flight = self.session.flight
        newest = flight.errors[-1]["time"] if flight.errors else 0.0
        text = markup.model_facts([f"{newest:.0f} s heard"], flight.model or "–", "", added_words(flight))
        if text != self.facts.content:
            self.facts.show(text)

    def _say(self) -> None:
        """One line: why the page is not up to date, what is under way, or what came of the last request."""
        session, flight = self.session, self.session.flight
        missing = presence_sentence(session.node, flight.is_there, flight.was_there, flight.silent)
        if session.job is not None:
            verb = "adding" if session.job.kind == ADD else "taking out"
            self.notice(f"{verb} {session.job.text}", False)
        elif missing and not flight.is_there:
            self.notice(missing, flight.was_there)
        elif session.sentence:
            self.notice(". ".join(t for t in (session.sentence, missing) if t), session.is_bad)
        else:
            self.notice(missing, False)
