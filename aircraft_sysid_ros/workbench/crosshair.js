// The time under the pointer, through all plots over time that can be seen: a line, and the values there with units.
(() => {
  const layer = document.createElement("div");
  layer.className = "crosshair";
  layer.setAttribute("aria-hidden", "true");
  const timed = () => [...document.querySelectorAll(".js-plotly-plot")].filter((p) => p._fullLayout?.meta === "time");

  // Index of the time that is nearest, of times that rise.
  function nearest(times, time) {
    let low = 0, high = times.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] < time) low = middle; else high = middle;
    }
    return Math.abs(times[low] - time) <= Math.abs(times[high] - time) ? low : high;
  }

  const axisOf = (plot, trace) => plot._fullLayout["yaxis" + (trace.yaxis ?? "y").slice(1)];

  function unitOf(plot, trace) {
    const unit = /\[([^\]]*)\]/.exec(axisOf(plot, trace)?.title?.text ?? "")?.[1] ?? "";
    return unit === "-" ? "" : " " + unit;
  }

  // As many places as the eye could tell in the plot: 200 steps from its bottom to its top.
  function rounded(plot, trace, value) {
    const [low, high] = axisOf(plot, trace).range;
    const places = Math.min(Math.max(Math.ceil(Math.log10(200 / Math.abs(high - low))), 0), 12);
    return value.toFixed(places).replace(/^-(?=[0.]*$)/, "").replace("-", "−");
  }

  // The lines of a plot with their points nearest to a time.
  function pointsAt(plot, time) {
    const {xaxis} = plot._fullLayout, reach = 0.01 * Math.abs(xaxis.range[1] - xaxis.range[0]);
    const found = [];
    for (const {x, y, visible, hoverinfo, type, ...trace} of plot._fullData ?? []) {
      if (visible !== true || hoverinfo === "skip" || type !== "scatter" || !x?.length) continue;
      const k = nearest(x, time);
      if (Math.abs(x[k] - time) <= reach) found.push({trace, time: x[k], value: y[k]});
    }
    return found;
  }

  // Values are those of one moment: that of the point which is nearest to the pointer. A gap has none.
  function values(plot, pointer) {
    const near = pointsAt(plot, pointer).filter(({value}) => Number.isFinite(value)).map(({time}) => time);
    if (!near.length) return {time: pointer, lines: []};
    const time = near.reduce((a, b) => (Math.abs(b - pointer) < Math.abs(a - pointer) ? b : a));
    const lines = pointsAt(plot, time).filter(({value}) => Number.isFinite(value)).map(({trace, value}) => [
      trace.line?.color, `${trace.name} ${rounded(plot, trace, value)}${unitOf(plot, trace)}`,
    ]);
    return {time, lines};
  }

  function mark(plot, time) {
    const {xaxis, _size: size} = plot._fullLayout, box = plot.getBoundingClientRect();
    if (!box.width || box.bottom < 0 || box.top > innerHeight) return;
    const along = xaxis.l2p(time);
    if (!(along >= 0 && along <= xaxis._length)) return;
    const left = box.left + xaxis._offset + along;
    const line = layer.appendChild(document.createElement("i"));
    Object.assign(line.style, {left: `${left}px`, top: `${box.top + size.t}px`, height: `${size.h}px`});
    const label = layer.appendChild(document.createElement("span"));
    const read = values(plot, time);
    label.append(`${read.time.toFixed(2)} s`);
    for (const [colour, text] of read.lines) {
      const part = label.appendChild(document.createElement("b"));
      part.textContent = text;
      part.style.borderColor = colour ?? "currentColor";
    }
    const width = label.offsetWidth, beside = along > 0.5 * xaxis._length ? left - 6 - width : left + 6;
    const inside = Math.max(Math.min(beside, innerWidth - 4 - width), 4); // a phone may have no room on either side
    Object.assign(label.style, {left: `${inside}px`, top: `${box.top + size.t + 2}px`});
  }

  let last = null;
  function draw() {
    const event = last;
    last = null;
    layer.replaceChildren();
    const plot = event?.target.closest?.(".js-plotly-plot");
    if (!plot || event.buttons || plot._fullLayout?.meta !== "time") return;
    const {xaxis} = plot._fullLayout;
    const along = event.clientX - plot.getBoundingClientRect().left - xaxis._offset;
    if (!(along >= 0 && along <= xaxis._length)) return;
    if (!layer.isConnected) document.body.append(layer);
    const time = xaxis.p2l(along);
    for (const each of timed()) mark(each, time);
  }
  function ask(event) {
    if (last === null) requestAnimationFrame(draw);
    last = event;
  }
  document.addEventListener("pointermove", ask, {passive: true});
  document.addEventListener("pointerdown", ask, {passive: true});
  addEventListener("scroll", () => layer.replaceChildren(), {capture: true, passive: true});
})();
