// The plots: curves over time from bins, and friction against speed from points.

const GAP = 0.3; // s without a sample, from which on a curve is interrupted
const MOST_POINTS = 2000;
// Of each curve what it is called, its colour and its width; the last one lies on top, so the one behind may be the broader.
const OVER_TIME = {
  error: [["error", "tracking error", "--first", 1.4]],
  speed: [["speed", "measured", "--first", 1.4], ["reference_speed", "reference", "--second", 1.4]],
  torque: [["torque_command", "command", "--second", 4], ["torque_applied", "applied", "--first", 1.2]],
  friction: [["friction_estimate", "observer's estimate", "--first", 2.4], ["friction_compensation", "compensator", "--second", 1.4]],
};
const TRAILS = [["friction_estimate", "observer's estimate", "--first"], ["friction_compensation", "compensator", "--second"]];

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const shown = (unit) => (_, value) => (value === null || value === undefined ? "–" : `${Number(value.toPrecision(5))} ${unit}`);

// What a window shows: of each curve the least and the largest value in each bin.
export class Store {
  constructor() {
    this.clear();
  }

  clear() {
    this.curves = {};
    this.points = {};
    this.now = this.zero = 0;
    this.width = 1;
    this.window = 1;
  }

  add(frame) {
    if (frame.clear) this.clear();
    Object.assign(this, { now: frame.now, zero: frame.zero, width: frame.width, window: frame.window });
    for (const [name, found] of Object.entries(frame.bins)) {
      const curve = (this.curves[name] ??= new Map());
      found.k.forEach((k, i) => curve.set(k, [found.lo[i], found.hi[i]]));
    }
    for (const [name, found] of Object.entries(frame.points)) {
      this.points[name] = [...(this.points[name] ?? []), ...found].slice(-MOST_POINTS);
    }
    const oldest = this.now - this.window / this.width - 2;
    for (const curve of Object.values(this.curves)) {
      for (const k of curve.keys()) {
        if (k >= oldest) break; // they came in order
        curve.delete(k);
      }
    }
  }

  range() {
    const end = (this.now - this.zero) * this.width;
    return [end - this.window, end];
  }

  // Times and a row for each curve, two points a bin; undefined: nothing there, null: an interruption.
  rows(names) {
    const count = Math.round(this.window / this.width) + 1;
    const first = Math.floor(this.now) - count + 1;
    const times = [];
    for (let i = 0; i < count; i++) times.push((first + i + 0.25 - this.zero) * this.width, (first + i + 0.75 - this.zero) * this.width);
    return [times, ...names.map((name) => row(count, (i) => this.curves[name]?.get(first + i), GAP / this.width))];
  }
}

function row(count, at, gap) {
  const values = new Array(2 * count);
  let last = -1;
  let middle = 0;
  for (let i = 0; i < count; i++) {
    const bin = at(i);
    if (!bin) continue;
    const [low, high] = bin;
    if (last >= 0 && i - last > Math.max(gap, 1.5)) values[2 * i - 1] = null;
    const rising = low !== null && (low + high) / 2 >= middle;
    values[2 * i] = rising ? low : high;
    values[2 * i + 1] = rising ? high : low;
    if (low !== null) middle = (low + high) / 2;
    last = i;
  }
  return values;
}

export class Plots {
  constructor(store, zoom, live) {
    this.store = store;
    this.zoom = zoom;
    this.live = live;
    this.held = null;
    this.made = [];
  }

  make(units) {
    this.units = units;
    for (const plot of this.made) plot.plot.destroy();
    this.made = [];
    const unit = { error: units.error, speed: units.speed, torque: units.torque, friction: units.torque };
    for (const [name, curves] of Object.entries(OVER_TIME)) this.made.push(this.overTime(name, curves, unit[name]));
    this.made.push(this.trail(units));
    this.draw(true);
  }

  axis(label) {
    return { label, size: 42, labelSize: 18, labelGap: 0, stroke: colour("--soft"), font: "12px system-ui, sans-serif",
      labelFont: "12px system-ui, sans-serif", grid: { stroke: colour("--grid"), width: 1 }, ticks: { stroke: colour("--grid"), width: 1 } };
  }

  values(axis) {
    return { ...axis, size: 68, values: (_, splits) => splits.map((v) => (v === null ? "" : String(Number(v.toPrecision(4))))) };
  }

  place(name, options, data) {
    const place = document.getElementById(`plot-${name}`);
    const height = place.classList.contains("tall") ? 320 : 215;
    const plot = new uPlot({ width: Math.max(place.clientWidth, 200), height, ...options }, data, place);
    new ResizeObserver(() => {
      const width = Math.max(place.clientWidth, 200);
      if (plot.width !== width) plot.setSize({ width, height });
    }).observe(place);
    return plot;
  }

  overTime(name, curves, unit) {
    const series = curves.map(([, label, ink, width]) => ({ label, stroke: colour(ink), width, points: { show: false }, value: shown(unit) }));
    const plot = this.place(name, {
      scales: { x: { time: false, range: () => this.held ?? this.store.range() }, y: { range: around } },
      cursor: { sync: { key: "time" }, drag: { x: true, y: false, setScale: false }, bind: { dblclick: () => () => this.live() } },
      axes: [this.axis("time of the run [s]"), this.values(this.axis(null))],
      series: [{ label: "time", value: shown("s") }, ...series],
      hooks: { setSelect: [(u) => this.selected(u)] },
      plugins: [byFinger],
    }, [[], ...curves.map(() => [])]);
    return { plot, names: curves.map(([curve]) => curve) };
  }

  trail(units) {
    const dots = (ink, size) => ({ stroke: colour(ink), paths: () => null,
      points: { show: true, size, space: 0, fill: colour(ink), stroke: colour(ink), width: 0 }, value: shown(units.torque) });
    const plot = this.place("trail", {
      scales: { x: { time: false, range: around }, y: { range: around } },
      cursor: { drag: { x: false, y: false } },
      axes: [{ ...this.values(this.axis(`speed [${units.speed}]`)), size: 42 }, this.values(this.axis(null))],
      series: [{ label: "speed", value: shown(units.speed) }, ...TRAILS.map(([, label, ink], i) => ({ label, ...dots(ink, 4 - i) }))],
    }, [[], [], []]);
    return { plot, trail: true };
  }

  selected(plot) {
    const { left, width } = plot.select;
    if (width < 4) return;
    const range = [plot.posToVal(left, "x"), plot.posToVal(left + width, "x")];
    plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    this.zoom(range);
  }

  // A range that is looked at closely, with the server's finer curves once they have come; null: live again.
  hold(range, curves) {
    this.held = range;
    this.fine = curves;
    this.draw(true);
  }

  draw(all) {
    for (const { plot, names, trail } of this.made) {
      if (trail) {
        if (all) plot.setData(points(this.store.points));
        document.getElementById("untraced").hidden = Object.keys(this.store.points).length > 0;
      } else if (this.held === null) {
        plot.setData(this.store.rows(names));
      } else if (all) {
        plot.setData(this.fine ? uPlot.join(names.map((name) => finely(this.fine[name]))) : this.store.rows(names));
      }
    }
  }
}

function finely(curve) {
  const times = [];
  const values = [];
  const half = curve.t.length > 1 ? (curve.t[1] - curve.t[0]) / 4 : 0;
  curve.t.forEach((t, i) => {
    const single = curve.lo[i] === curve.hi[i];
    times.push(single ? t : t - half);
    values.push(curve.lo[i]);
    if (!single) times.push(t + half), values.push(curve.hi[i]);
  });
  return [times, values];
}

function points(trails) {
  return uPlot.join(TRAILS.map(([name]) => {
    const sorted = [...(trails[name] ?? [])].sort((a, b) => a[0] - b[0]).filter((p, i, all) => !i || p[0] !== all[i - 1][0]);
    return [sorted.map((p) => p[0]), sorted.map((p) => p[1])];
  }));
}

// A range with some air, and never of no width.
function around(_, low, high) {
  if (low === null || high === null || low === undefined) return [-1, 1];
  const span = high - low || Math.abs(high) * 0.2 || 1;
  return [low - 0.06 * span, high + 0.06 * span];
}
