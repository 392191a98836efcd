// A plugin of uPlot: a finger drawn across a plot selects as the mouse does, two taps go back. Up and down it scrolls the page.
const byFinger = (() => {
  "use strict";
  const ACROSS = 8; // px from which a finger selects
  const TWICE = 350; // ms from tap to tap

  function init({ over }) {
    let from = null, selects = false, tapped = -Infinity;
    const mouse = (kind, { clientX, clientY }) => over.dispatchEvent(new MouseEvent(kind, { bubbles: true, clientX, clientY, movementX: 1 }));
    const hear = (kind, act) => over.addEventListener(kind, (event) => event.pointerType === "touch" && event.isPrimary && act(event));
    over.style.touchAction = "pan-y";
    hear("pointerdown", (event) => {
      from = event;
      selects = false;
    });
    hear("pointermove", (event) => {
      if (from && !selects && Math.abs(event.clientX - from.clientX) >= ACROSS) {
        selects = true;
        mouse("mousedown", from);
      }
      if (selects) mouse("mousemove", event);
    });
    const end = (event) => {
      if (selects) mouse("mouseup", event);
      from = null;
      selects = false;
    };
    hear("pointercancel", end);
    hear("pointerup", (event) => {
      if (!selects && event.timeStamp - tapped < TWICE) mouse("dblclick", event);
      tapped = selects ? -Infinity : event.timeStamp;
      end(event);
    });
  }

  return { hooks: { init } };
})();
