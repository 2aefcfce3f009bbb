// The time under the pointer, through all plots over time that can be seen: a line, and the values there with units.
(() => {
  const layer = document.createElement("div");
  layer.className = "crosshair";
  layer.setAttribute("aria-hidden", "true");
  const timed = () => [...document.querySelectorAll(".js-plotly-plot")].filter((p) => p._fullLayout?.meta === "time");

  function nearest(points, time) {
    let low = 0, high = points.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (points[middle].x < time) low = middle; else high = middle;
    }
    return Math.abs(points[low].x - time) < Math.abs(points[high].x - time) ? points[low] : points[high];
  }

  function unitOf(plot, trace) {
    const axis = plot._fullLayout["yaxis" + (trace.yaxis ?? "y").slice(1)];
    const unit = /\[([^\]]*)\]/.exec(axis?.title?.text ?? "")?.[1] ?? "";
    return unit === "-" ? "" : " " + unit;
  }

  function values(plot, time) {
    const {xaxis} = plot._fullLayout, reach = 0.01 * Math.abs(xaxis.range[1] - xaxis.range[0]);
    const found = [];
    for (const all of plot.calcdata ?? []) {
      const trace = all[0]?.trace;
      if (!trace || trace.visible !== true || trace.hoverinfo === "skip" || trace.type !== "scatter") continue;
      const points = all.filter((p) => Number.isFinite(p.x) && Number.isFinite(p.y)); // gaps have neither
      if (!points.length) continue;
      const at = nearest(points, time);
      if (Math.abs(at.x - time) > reach) continue;
      const text = Number(at.y.toPrecision(4)).toString().replace("-", "−");
      found.push([trace.line?.color, `${trace.name} ${text}${unitOf(plot, trace)}`]);
    }
    return found;
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
    label.append(`${time.toFixed(2)} s`);
    for (const [colour, text] of values(plot, time)) {
      const part = label.appendChild(document.createElement("b"));
      part.textContent = text;
      part.style.borderColor = colour ?? "currentColor";
    }
    const side = along > 0.5 * xaxis._length ? {right: `${innerWidth - left + 6}px`} : {left: `${left + 6}px`};
    Object.assign(label.style, side, {top: `${box.top + size.t + 2}px`});
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
