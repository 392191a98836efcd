// Makes a figure that can be zoomed and read off of every plot in the page, by uPlot. The numbers come from the JSON beside each plot
// (`report/plot_page.py`). Whatever fails leaves the picture where it is. Texts reach the page as text alone, never as markup.
(() => {
  "use strict";
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const tone = (pair) => pair[dark.matches ? 1 : 0];
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const SPACING = { linear: 1, log: 3, asinh: 4 };
  const FONT = "12px system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif";

  // Numbers as people read them: so many significant digits, no exponents where they are not needed.
  function number(value, digits) {
    if (value === 0) return "0";
    const size = Math.abs(value);
    if (size >= 1e6 || size < 1e-4) return value.toExponential(digits - 1).replace(/\.?0+e/, "e").replace("e+", "e");
    return String(Number(value.toPrecision(digits)));
  }

  function told(value, scale) {
    if (value === null || value === undefined) return "–";
    for (const [at, words] of scale.ticks) if (at === value) return words;
    let words = number(value, 5) + (scale.unit ? " " + scale.unit : "");
    if (scale.also) words += " (" + number(value * scale.also[1], 4) + " " + scale.also[0] + ")";
    return words;
  }

  // One row for every x. A curve without a value there has `undefined`, which is no gap; `null` is one.
  function merged(curves) {
    const every = [];
    curves.forEach((curve, which) => curve.x.forEach((x, k) => { if (x !== null) every.push([x, which, curve.y[k]]); }));
    every.sort((a, b) => a[0] - b[0]);
    const rows = [[], ...curves.map(() => [])];
    let last = -1;
    for (const [x, which, y] of every) {
      if (last < 0 || rows[0][last] !== x || rows[which + 1][last] !== undefined) {
        last = rows[0].push(x) - 1;
        for (let k = 1; k < rows.length; k++) rows[k].push(undefined);
      }
      rows[which + 1][last] = y;
    }
    return rows;
  }

  // The index nearest to the cursor at which this curve has a value: other curves may have been measured at other x.
  function nearest(plot, series, index, x) {
    const at = plot.data[0], values = plot.data[series];
    if (series === 0 || values[index] !== undefined) return index;
    let left = index, right = index;
    while (left >= 0 && values[left] === undefined) left--;
    while (right < values.length && values[right] === undefined) right++;
    if (left < 0) return right < values.length ? right : index;
    if (right >= values.length) return left;
    return x - at[left] < at[right] - x ? left : right;
  }

  function inside(plot, draw) {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    draw(ctx, (x) => plot.valToPos(x, "x", true), (y) => plot.valToPos(y, "y", true), bbox);
    ctx.restore();
  }

  const drawSpans = (panel) => (plot) => inside(plot, (ctx, x, _, box) => {
    ctx.fillStyle = css("--span");
    for (const [start, stop] of panel.spans) ctx.fillRect(x(start), box.top, x(stop) - x(start), box.height);
  });

  const drawBands = (panel) => (plot) => inside(plot, (ctx, x, y) => {
    for (const curve of panel.curves) {
      if (!curve.low || curve.points || !plot.series[1 + panel.curves.indexOf(curve)].show) continue;
      const known = curve.x.map((_, k) => k).filter((k) => curve.low[k] !== null && curve.high[k] !== null);
      ctx.fillStyle = tone(curve.color);
      ctx.globalAlpha = 0.22;
      ctx.beginPath();
      known.forEach((k, n) => ctx[n ? "lineTo" : "moveTo"](x(curve.x[k]), y(curve.high[k])));
      known.reverse().forEach((k) => ctx.lineTo(x(curve.x[k]), y(curve.low[k])));
      ctx.closePath();
      ctx.fill();
    }
  });

  const drawBars = (panel) => (plot) => inside(plot, (ctx, x, y) => {
    ctx.lineWidth = devicePixelRatio;
    for (const curve of panel.curves) {
      if (!curve.low || !curve.points || !plot.series[1 + panel.curves.indexOf(curve)].show) continue;
      ctx.strokeStyle = tone(curve.color);
      ctx.globalAlpha = 0.45;
      ctx.beginPath();
      curve.x.forEach((at, k) => {
        if (curve.low[k] === null || curve.high[k] === null) return;
        ctx.moveTo(x(at), y(curve.low[k]));
        ctx.lineTo(x(at), y(curve.high[k]));
      });
      ctx.stroke();
    }
  });

  const drawRules = (panel) => (plot) => inside(plot, (ctx, x, y, box) => {
    ctx.lineWidth = devicePixelRatio;
    for (const rule of panel.rules) {
      ctx.strokeStyle = tone(rule.color);
      ctx.setLineDash(rule.dashed ? [6 * devicePixelRatio, 4 * devicePixelRatio] : []);
      ctx.beginPath();
      if (rule.across === "y") {
        ctx.moveTo(box.left, y(rule.at));
        ctx.lineTo(box.left + box.width, y(rule.at));
      } else {
        ctx.moveTo(x(rule.at), box.top);
        ctx.lineTo(x(rule.at), box.top + box.height);
      }
      ctx.stroke();
    }
  });

  const series = (curve, scale) => ({
    label: curve.name || scale.name,
    stroke: () => tone(curve.color),
    fill: undefined,
    width: curve.points ? 0 : curve.size,
    dash: curve.dashed ? [6, 4] : undefined,
    paths: curve.points ? () => null : undefined,
    points: curve.points
      ? { show: true, size: Math.max(curve.size * 1.3, 2), width: curve.hollow ? 1.2 : 0,
          fill: () => (curve.hollow ? css("--panel") : tone(curve.color)), stroke: () => tone(curve.color) }
      : { show: false },
    value: (_, value) => told(value, scale),
  });

  // `bare`: another panel below has the same x and its numbers.
  // Linked panels have axes of one width, so that the same x lies below the same x.
  const WIDTH = 76;
  const axis = (scale, upright, bare = false, linked = false) => ({
    label: bare ? undefined : scale.label,
    font: FONT,
    labelFont: FONT,
    labelSize: 18,
    labelGap: 0,
    stroke: () => css("--soft"),
    grid: { stroke: () => css("--grid"), width: 1 },
    ticks: { stroke: () => css("--grid"), width: 1, size: 5 },
    space: upright ? 26 : 52,
    ...(upright ? { size: (_, words) => linked ? WIDTH : 16 + 7 * Math.max(5, ...(words || []).map((word) => (word || "").length)) } : { size: bare ? 8 : 30 }),
    ...(scale.ticks.length ? { splits: () => scale.ticks.map((tick) => tick[0]) } : {}),
    values: (_, splits) => splits.map((at) => {
      if (at === null || bare) return null;
      const named = scale.ticks.find((tick) => tick[0] === at);
      if (scale.spacing === "log" && Number(at.toPrecision(1)) !== Number(at.toPrecision(6))) return "";
      return named ? named[1] : number(at, 6);
    }),
  });

  function reset(plot, panel) {
    plot.batch(() => {
      plot.setScale("x", { min: panel.x.limits[0], max: panel.x.limits[1] });
      plot.setScale("y", { min: panel.y.limits[0], max: panel.y.limits[1] });
    });
  }

  function scale(declared) {
    return {
      time: false,
      auto: false,
      distr: SPACING[declared.spacing],
      asinh: declared.linear,
      min: declared.limits[0],
      max: declared.limits[1],
      range: (_, min, max) => [min, max],
    };
  }

  function options(panel, cell, height, group, key, bare) {  // key: of linked panels
    return {
      width: cell.clientWidth,
      height,
      scales: { x: scale(panel.x), y: scale(panel.y) },
      axes: [axis(panel.x, false, bare), axis(panel.y, true, false, key !== null)],
      series: [{ label: panel.x.name, value: (_, value) => told(value, panel.x) }, ...panel.curves.map((c) => series(c, panel.y))],
      legend: {
        show: true,
        live: true,
        markers: {
          width: 1.5,
          stroke: (_, k) => (k ? tone(panel.curves[k - 1].color) : "transparent"),
          dash: (_, k) => (k && panel.curves[k - 1].dashed ? "dashed" : "solid"),
          fill: (_, k) => (k && !panel.curves[k - 1].hollow && !panel.curves[k - 1].dashed ? tone(panel.curves[k - 1].color) : "transparent"),
        },
      },
      cursor: {
        dataIdx: nearest,
        drag: { x: true, y: true, uni: 40, dist: 5 },
        points: { size: 7 },
        bind: { dblclick: () => () => group.forEach(([plot, shown]) => reset(plot, shown)) },
        ...(key ? { sync: { key, scales: ["x", null] } } : {}),
      },
      plugins: [byFinger],
      hooks: { drawClear: [drawSpans(panel)], drawAxes: [drawBands(panel), drawRules(panel), drawBars(panel)] },
    };
  }

  function element(parent, name, words) {
    const made = document.createElement("div");
    made.className = name;
    if (words) made.textContent = words;
    parent.appendChild(made);
    return made;
  }

  // A group shares its cursor and its zoom: all panels of a linked plot, otherwise each panel by itself.
  function build(figure, content, key) {
    const host = figure.querySelector(".live"), made = [], shared = [];
    figure.classList.add("ready");
    host.replaceChildren();
    host.setAttribute("role", "img");
    host.setAttribute("aria-label", content.caption);
    content.rows.forEach(({ height, panels }, number) => {
      const bare = content.linked && number + 1 < content.rows.length;
      const row = element(host, "row");
      row.style.gridTemplateColumns = content.widths.slice(0, panels.length).map((share) => `minmax(0,${share}fr)`).join(" ");
      for (const panel of panels) {
        const cell = element(row, "cell");
        if (panels.some((other) => other.title)) {
          const title = element(cell, "title", panel.title || "\u00a0");  // what lies side by side begins at the same height
          if (panel.titleColor) title.style.color = tone(panel.titleColor);
        }
        const group = content.linked ? shared : [];
        const plot = new uPlot(options(panel, cell, height, group, content.linked ? key : null, bare), merged(panel.curves), cell);
        group.push([plot, panel]);
        made.push([plot, cell]);
        reset(plot, panel);
      }
    });
    return made;
  }

  const figures = [...document.querySelectorAll("figure.plot")].map((figure, k) => ({
    figure, key: `plot-${k}`, content: JSON.parse(figure.querySelector('script[type="application/json"]').textContent), made: [],
  }));

  function show(one) {
    one.made.forEach(([plot]) => plot.destroy());
    try {
      one.made = build(one.figure, one.content, one.key);
    } catch (error) {
      one.made = [];
      one.figure.classList.remove("ready");
      console.error(error);
    }
  }

  const widths = new ResizeObserver(() => {
    for (const { made } of figures) {
      for (const [plot, cell] of made) {
        if (cell.clientWidth && cell.clientWidth !== plot.width) plot.setSize({ width: cell.clientWidth, height: plot.height });
      }
    }
  });
  figures.forEach(show);
  figures.forEach(({ figure }) => widths.observe(figure));
  dark.addEventListener("change", () => figures.forEach(show));
})();
