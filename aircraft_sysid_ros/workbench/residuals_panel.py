"""The view of the residuals against the noise, and of the frequency responses, which need no model."""

from __future__ import annotations

from nicegui import ui

from aircraft_sysid_ros.diagnosis.frequency_responses import rate_responses
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.panel import Html, Panel, card, plot
from aircraft_sysid_ros.workbench.views import responses
from aircraft_sysid_ros.workbench.views.coefficients import ORDER
from aircraft_sysid_ros.workbench.views.numbers import coefficients_csv
from aircraft_sysid_ros.workbench.views.residuals import residual_figure, residual_rows

WORDS = (
    "On flight that was not fitted, over the noise that the sensors had in this flight. A perfect model leaves "
    "95 % within two sigma, 0.3 % beyond three, and no correlation."
)


class ResidualsPanel(Panel):
    """A table, and a figure for each axis."""

    def build(self) -> None:
        """Make everything."""
        with ui.element("div").classes("view wide"):
            with card("Residuals against the noise of the sensors"):
                ui.label(WORDS).classes("soft small")
                self._table = Html().props("data-testid=residual-numbers")
                button = ui.button("Coefficients as CSV", icon="download", on_click=self._download)
                button.props("flat dense data-testid=save-coefficients").style("margin-top:8px")
            with ui.element("div").classes("legend").props("data-testid=distribution-legend"):
                Html(markup.DISTRIBUTION_LEGEND).style("display:contents")
            self._place = ui.element("div").classes("grid2")
            with card("Frequency responses").props("data-testid=responses") as self._responses:
                ui.label(responses.WORDS).classes("soft small")
            self._of_rates = ui.element("div").classes("grid2")
        self.update()

    def update(self) -> None:
        """After a change of the run or the theme."""
        comparison = self.page.view.comparison
        self._table.show(markup.residual_numbers(residual_rows(comparison)))
        self._place.clear()
        with self._place:
            for name in (name for name in ORDER if name in comparison.axes):
                with card():
                    Html(markup.axis_title(name))
                    made = residual_figure(comparison, name, self.page.look.theme)
                    plot(made, f"residual of {name}: histogram and autocorrelation").props(
                        f"data-testid=distribution-{name}"
                    )

        self._update_responses()

    def _update_responses(self) -> None:
        found = rate_responses(self.page.view.flight)
        self._responses.set_visibility(bool(found))
        self._of_rates.clear()
        with self._of_rates:
            for each in found:
                words = responses.title(each)
                with card(words):
                    made = responses.response_figure(each, self.page.look.theme)
                    plot(made, f"frequency response of {words}: magnitude, phase and coherence").props(
                        f"data-testid=response-{each.rate}-{each.control}"
                    )

    def _download(self) -> None:
        view = self.page.view
        name = f"{self.page.session.name}_coefficients_{view.current}.csv"
        ui.download.content(coefficients_csv(view.comparison), name, "text/csv")
