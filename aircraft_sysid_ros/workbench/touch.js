// A figure under a finger: a tap reads it, a stroke along it zooms, a stroke up or down moves the page, as beside it.
// plotly.js takes every touch for the begin of a zoom, so that a page full of figures could not be moved on a phone.
(() => {
  const REACH = 8; // [px] from where on it is a stroke and no tap
  let begun = null, passed = null;
  const far = (a, b) => Math.max(Math.abs(a.clientX - b.clientX), Math.abs(a.clientY - b.clientY)) > REACH;

  addEventListener("touchstart", (event) => {
    if (event === passed) return;
    begun = null;
    if (!event.target.closest?.(".js-plotly-plot .draglayer")) return;
    event.stopPropagation(); // plotly.js has it once it is a stroke along the figure
    if (event.touches.length === 1) begun = event;
  }, {capture: true, passive: true});

  addEventListener("touchmove", (event) => {
    if (!begun) return;
    const [from] = begun.touches, [to] = event.touches;
    if (!far(from, to)) return event.stopPropagation();
    const {target, touches, targetTouches, changedTouches} = begun;
    begun = null;
    if (!event.cancelable) return; // the page still moves
    if (Math.abs(to.clientX - from.clientX) <= Math.abs(to.clientY - from.clientY)) return;
    passed = new TouchEvent("touchstart", {touches: [...touches], targetTouches: [...targetTouches],
      changedTouches: [...changedTouches], bubbles: true, cancelable: true});
    target.dispatchEvent(passed);
  }, {capture: true, passive: true});

  // As of a mouse that has come there: crosshair.js draws its line, and plotly.js is not told of it.
  addEventListener("touchend", (event) => {
    if (!begun) return;
    const {target, touches: [{clientX, clientY}]} = begun;
    begun = null;
    requestAnimationFrame(() => target.dispatchEvent(
      new PointerEvent("pointermove", {clientX, clientY, bubbles: true}),
    ));
  }, {capture: true, passive: true});
})();
