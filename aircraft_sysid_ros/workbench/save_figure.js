// A figure that is saved says by itself what it is: a title, the names of its lines, its ground, and a name of its own.
(() => {
  const words = (plot) => plot.getAttribute("aria-label") ?? "figure";
  const run = () => document.title.split(" · ")[0];
  const text = (plain) => plain.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");
  const ROOM = 64; // [px] for title and names above the figure

  // plotly.js copies the layout while the button is pressed: afterwards it is again as the page shows it.
  document.addEventListener("click", (event) => {
    const plot = event.target.closest?.(".modebar-btn")?.closest(".js-plotly-plot");
    if (!plot) return;
    const {layout, _context: context} = plot, shown = {...layout}, options = context.toImageButtonOptions;
    const {width, height} = plot._fullLayout;
    const card = getComputedStyle(plot.closest(".card") ?? document.body);
    Object.assign(layout, {
      title: {text: text(`${run()}: ${words(plot)}`), x: 0, xref: "container", y: 1, yref: "container", yanchor: "top",
        pad: {t: 8, l: 12}, font: {size: 13, color: card.color}},
      showlegend: true, paper_bgcolor: card.backgroundColor,
      margin: {...layout.margin, t: (layout.margin?.t ?? 0) + ROOM},
    });
    const filename = `${run()} ${words(plot)}`.replaceAll(/[^\p{L}\p{N}]+/gu, "-").slice(0, 80);
    context.toImageButtonOptions = {...options, filename, width, height: height + ROOM};
    setTimeout(() => {
      for (const key of Object.keys(layout)) if (!(key in shown)) delete layout[key];
      Object.assign(layout, shown);
      context.toImageButtonOptions = options;
    });
  }, true);
})();
