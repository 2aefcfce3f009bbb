// What the frame of a page does by itself: it follows the height of its header, light and dark of the system, windows
// that grow, and whoever turns from the tabs to a figure.
(() => {
  // The column beside the plots stands below the header, which a notice makes higher.
  addEventListener("DOMContentLoaded", () => {
    const watched = new MutationObserver(() => {
      const top = document.querySelector("header.top");
      if (!top) return;
      watched.disconnect();
      const tell = () => document.documentElement.style.setProperty("--top", `${top.offsetHeight}px`);
      new ResizeObserver(tell).observe(top);
      tell();
    });
    watched.observe(document.body, {childList: true, subtree: true});
  });

  // Arrow keys move the window of time once something else than the tabs was pressed: they had them still.
  addEventListener("pointerdown", (event) => {
    const focused = document.activeElement;
    if (focused?.closest?.("[role=tablist]") && !event.target.closest?.("[role=tablist]")) focused.blur();
  }, {capture: true, passive: true});

  // The legend of a figure that was narrow keeps its place of then, in the middle of the plot, when plotly.js draws it
  // in a new width: which it does when it comes to it, in a slow browser a second later.
  const menders = new WeakMap();
  const mender = (plot) => {
    let placed;  // in this width
    return () => {
      const {showlegend, width} = plot._fullLayout ?? {};
      if (!showlegend || !plot.offsetWidth || !window.Plotly || placed === width) return;
      placed = width;
      Plotly.relayout(plot, {"margin.t": plot.layout.margin?.t ?? 6, "legend.y": plot.layout.legend?.y ?? 1});
    };
  };
  addEventListener("resize", () => {
    for (const plot of document.querySelectorAll(".js-plotly-plot")) {
      if (!menders.has(plot)) menders.set(plot, mender(plot));
      plot.removeListener("plotly_afterplot", menders.get(plot));  // a figure that was made anew has lost it
      plot.on("plotly_afterplot", menders.get(plot));
    }
  });

  // Light or dark of the system, as long as nothing was chosen.
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", (event) => {
    if (!/theme=(light|dark)(;|$)/.test(document.cookie)) window.emitEvent?.("system-theme", event.matches);
  });
})();
