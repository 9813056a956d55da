// Traces, spectrum and loop with uPlot. Every column of a trace is drawn from its lowest to its highest value.

const TICK_HZ = 5000;
const ROOM = 0.08;
const R = 0, X = 1, E = 2, U = 3, FF = 4, FB = 5;
const AXIS_WIDTH = 58;
// Of a trace: as many as a window of a screen has pixels.
const MOST_COLUMNS = 1000;

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export function colours() {
  const named = Object.fromEntries(["x", "y", "z", "ink", "soft", "grid", "drop", "line"].map((name) => [name, css(`--${name}`)]));
  return { ...named, of: (axis) => named[axis] };
}

// With as many digits as tell two neighbours apart; uPlot rounds to three.
export function numbers(values, step) {
  let digits = 0;
  while (digits < 12 && Math.abs(Math.round(step * 10 ** digits) - step * 10 ** digits) > 1e-6 * step * 10 ** digits) digits++;
  return values.map((value) => (value === null ? "" : value.toLocaleString(undefined, { maximumFractionDigits: digits })));
}

function look(colour) {
  const axis = { stroke: colour.soft, grid: { stroke: colour.grid, width: 1 }, ticks: { show: false }, font: "11px system-ui" };
  const labels = (plot, values, at, space, step) => numbers(values, step);
  const seconds = (plot, values) => values.map((value) => `${value} s`);
  return { axes: [{ ...axis, size: 26, values: seconds }, { ...axis, size: AXIS_WIDTH, values: labels }], legend: { show: false }, cursor: { show: false }, padding: [8, 10, 0, 0] };
}

// A range that follows its data at once when they grow, and only when they shrink to less than three quarters.
function steady(now, low, high) {
  if (!(high >= low)) return now ?? [-1, 1];
  const room = Math.max((high - low) * ROOM, 1e-3 * Math.max(1, Math.abs(high)));
  const wanted = [low - room, high + room];
  if (now && wanted[0] + room >= now[0] && wanted[1] - room <= now[1] && wanted[1] - wanted[0] > 0.75 * (now[1] - now[0])) return now;
  return wanted;
}

// Whole decades, five at most, and none that no amplitude can have.
function decades(low, high) {
  const top = high > 1e-6 && high < 1e6 ? Math.ceil(Math.log10(high)) : 0;
  const bottom = low > 1e-7 ? Math.floor(Math.log10(low)) : top - 5;
  return [10 ** Math.min(top - 1, Math.max(bottom, top - 5)), 10 ** top];
}

// Grid and labels are uPlot's, drawn when a range changes. The traces lie over them on a canvas of their own, which is
// shifted as columns come, so that a frame costs its new columns alone.
class Traces {
  constructor(host, axes, lines, onResize) {
    this.host = host;
    this.lines = axes.flatMap((axis, i) => lines.map((line) => ({ ...line, axis, at: i })));
    this.shown = new Set(axes);
    this.onResize = onResize;
    this.range = null;
    this.canvas = Object.assign(document.createElement("canvas"), { className: "bands" });
    this.ctx = this.canvas.getContext("2d");
    this.build();
    new ResizeObserver(() => this.fit()).observe(host);
  }

  build() {
    this.colour = colours();
    this.plot?.destroy();
    this.plot = new uPlot({
      ...look(this.colour), ...this.size(),
      scales: { x: { time: false, range: () => this.span ?? [-1, 0] }, y: { range: () => this.range ?? [-1, 1] } },
      series: [{}, { paths: () => null, points: { show: false } }],
    }, [[0], [0]], this.host);
    this.plot.over.append(this.canvas);
    this.again();
  }

  size() {
    return { width: Math.max(this.host.clientWidth, 120), height: this.host.clientHeight };
  }

  fit() {
    this.plot.setSize(this.size());
    this.again();
    this.onResize?.();
  }

  show(axis, on) {
    if (on) this.shown.add(axis); else this.shown.delete(axis);
    this.range = null;
    this.again();
  }

  // Everything anew, now where there is something, else with the next frame.
  again() {
    this.drawn = null;
    if (this.store) this.draw(this.store);
  }

  draw(store) {
    this.store = store;
    let low = Infinity, high = -Infinity;
    for (const line of this.lines) {
      if (!this.shown.has(line.axis)) continue;
      const [lows, highs] = store.trace(line.at, line.trace);
      for (let i = 0; i < lows.length; i++) {
        if (lows[i] < low) low = lows[i];
        if (highs[i] > high) high = highs[i];
      }
    }
    const range = steady(this.range, low, high);
    if (range !== this.range || this.span?.[0] !== store.span[0] || this.span?.[1] !== store.span[1]) {
      [this.range, this.span, this.drawn] = [range, store.span, null];
      this.plot.setData([[0], [0]], true);
    }
    const { canvas, plot: { bbox } } = this, fits = canvas.width === Math.round(bbox.width) && canvas.height === Math.round(bbox.height);
    if (fits && this.drawn?.reset === store.resets) this.shift(store); else this.whole(store);
  }

  whole(store) {
    const { width, height } = this.plot.bbox;
    [this.canvas.width, this.canvas.height] = [Math.round(width), Math.round(height)];
    this.drawn = { reset: store.resets, from: store.added, to: store.added, shifted: 0, perColumn: this.canvas.width / store.capacity };
    this.strip(0);
    if (!store.shot) return;
    this.ctx.fillStyle = this.colour.soft;
    this.ctx.fillRect(Math.round(this.plot.valToPos(0, "x", true) - this.plot.bbox.left), 0, Math.max(1, devicePixelRatio), this.canvas.height);
  }

  // By whole pixels: what a column is wider or narrower is made up for as soon as it has become one.
  shift(store) {
    const { canvas, ctx, drawn } = this;
    if (store.added === drawn.to) return;
    const shifted = Math.floor((store.added - drawn.from) * drawn.perColumn), by = shifted - drawn.shifted;
    const kept = Math.floor((store.capacity - 1 + drawn.to - drawn.from) * drawn.perColumn - shifted);
    if (kept <= 0) return this.whole(store);
    if (by > 0) {
      ctx.globalCompositeOperation = "copy";
      ctx.drawImage(canvas, by, 0, canvas.width - by, canvas.height, 0, 0, canvas.width - by, canvas.height);
      ctx.globalCompositeOperation = "source-over";
    }
    [drawn.to, drawn.shifted] = [store.added, shifted];
    this.strip(kept);
  }

  // Draws from this pixel to the right end.
  strip(left) {
    const { canvas, ctx, drawn, store } = this, late = store.added - drawn.from;
    const x = (column) => (column + late) * drawn.perColumn - drawn.shifted;
    const first = Math.max(0, Math.floor((left + drawn.shifted) / drawn.perColumn) - late - 1);
    ctx.save();
    ctx.beginPath();
    ctx.rect(left, 0, canvas.width - left, canvas.height);
    ctx.clip();
    ctx.clearRect(left, 0, canvas.width - left, canvas.height);
    if (store.anyLost) {
      ctx.fillStyle = this.colour.drop;
      for (let i = first; i < store.capacity; i++) if (store.lost[i]) ctx.fillRect(x(i), 0, Math.max(drawn.perColumn, 2), canvas.height);
    }
    for (const line of this.lines) {
      if (!this.shown.has(line.axis)) continue;
      ctx.fillStyle = this.colour.of(line.axis) + (line.pale ?? "");
      ctx.fill(this.band(line, first, x));
    }
    ctx.restore();
  }

  // The band from the lowest to the highest value of every column: filled, it costs a fraction of a stroked line.
  band(line, first, x) {
    const path = new Path2D(), [low, high] = this.store.trace(line.at, line.trace), [min, max] = this.range;
    const perUnit = this.canvas.height / (max - min), half = ((line.width ?? 1.4) * devicePixelRatio) / 2;
    const y = (value) => (max - value) * perUnit;
    for (let i = first; i < low.length; i++) {
      if (low[i] !== low[i]) continue;
      let end = i;
      while (end < low.length && low[end] === low[end]) end++;
      path.moveTo(x(i), y(high[i]) - half);
      for (let k = i + 1; k < end; k++) path.lineTo(x(k), y(high[k]) - half);
      for (let k = end - 1; k >= i; k--) path.lineTo(x(k), y(low[k]) + half);
      path.closePath();
      i = end;
    }
    return path;
  }
}

// What has come of every trace: its lowest and its highest value in every column, newest last.
export class Store {
  constructor(axes, traces) {
    this.axes = axes;
    this.traces = traces;
    this.resets = 0;
    this.reset(1, 1, null);
  }

  reset(capacity, ticks, start) {
    this.capacity = capacity;
    this.resets++;
    this.added = 0;
    const made = () => Array.from({ length: this.axes * this.traces }, () => new Float32Array(capacity).fill(NaN));
    this.low = made();
    this.high = made();
    this.lost = new Uint8Array(capacity);
    this.anyLost = false;
    this.shot = start !== null;
    const dt = ticks / TICK_HZ, from = start ?? -capacity * dt;
    this.span = [from, from + capacity * dt];
  }

  trace(axis, trace) {
    const row = axis * this.traces + trace;
    return [this.low[row], this.high[row]];
  }

  add(frame, capacity) {
    const shot = !Number.isNaN(frame.trigger);
    if (frame.anew) this.reset(shot ? frame.columns : capacity, frame.ticks, shot ? (frame.first - frame.trigger) / TICK_HZ : null);
    const n = Math.min(frame.columns, this.capacity), skip = frame.columns - n;
    for (const [rows, came] of [[this.low, frame.low], [this.high, frame.high]]) {
      rows.forEach((values, row) => {
        values.copyWithin(0, n);
        values.set(came.subarray(row * frame.columns + skip, (row + 1) * frame.columns), values.length - n);
      });
    }
    this.added += n;
    this.lost.copyWithin(0, n);
    this.lost.set(frame.lost.subarray(skip), this.capacity - n);
    this.anyLost = this.lost.some((one) => one);
  }
}

export class Figures {
  constructor(axes, onResize) {
    const at = (id) => document.getElementById(id);
    this.axes = axes;
    this.traces = [
      new Traces(at("position"), axes, [{ trace: R, pale: "70", width: 1 }, { trace: X }], onResize),
      new Traces(at("error"), axes, [{ trace: E }]),
      new Traces(at("effort"), axes, [{ trace: FF, pale: "70", width: 1 }, { trace: U }]),
      new Traces(at("feedback"), axes, [{ trace: FB }]),
    ];
    this.shown = new Set(axes);
    this.spectrumHost = at("spectrum");
    this.loopHost = at("loop");
    this.buildRest();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.traces.forEach((one) => one.build());
      this.buildRest();
    });
    new ResizeObserver(() => {
      this.spectrum.setSize(this.sizeOf(this.spectrumHost));
      this.loop.setSize(this.sizeOf(this.loopHost));
    }).observe(this.spectrumHost);
  }

  sizeOf(host) {
    return { width: Math.max(host.clientWidth, 120), height: host.clientHeight };
  }

  buildRest() {
    const colour = colours();
    this.spectrum?.destroy();
    this.loop?.destroy();
    const series = this.axes.map((axis) => ({ stroke: colour.of(axis), width: 1.25, points: { show: false }, show: this.shown.has(axis) }));
    const base = look(colour);
    const decade = (v) => Math.abs(Math.log10(v) - Math.round(Math.log10(v))) < 1e-6;
    const grid = { ...base.axes[0].grid, filter: (plot, splits) => splits.map((v) => (decade(v) ? v : null)) };
    const tidy = (values) => values.map((v) => (v === null || !decade(v) ? "" : v >= 1 ? `${v}` : `${+v.toPrecision(1)}`));
    this.spectrum = new uPlot({
      ...base, ...this.sizeOf(this.spectrumHost),
      axes: [{ ...base.axes[0], grid, values: (u, v) => tidy(v).map((one) => one && `${one} Hz`) }, { ...base.axes[1], grid, values: (u, v) => tidy(v) }],
      scales: { x: { time: false, distr: 3, range: () => [0.6, 2500] }, y: { distr: 3, range: (u, low, high) => decades(low, high) } },
      series: [{}, ...series],
    }, [[1], ...this.axes.map(() => [1])], this.spectrumHost);
    const draw = (u, index) => {
      uPlot.orient(u, index, (one, dataX, dataY, scaleX, scaleY, posX, posY, left, top, width, height) => {
        const [across, up] = u.data[index];
        const path = new Path2D();
        let pen = false;
        for (let i = 0; i < across.length; i++) {
          if (Number.isNaN(across[i]) || Number.isNaN(up[i])) { pen = false; continue; }
          const px = posX(across[i], scaleX, width, left), py = posY(up[i], scaleY, height, top);
          if (pen) path.lineTo(px, py); else path.moveTo(px, py);
          pen = true;
        }
        u.ctx.save();
        u.ctx.strokeStyle = colour.of(this.axes[index - 1]);
        u.ctx.lineWidth = 1.25 * devicePixelRatio;
        u.ctx.stroke(path);
        u.ctx.restore();
      });
      return null;
    };
    const facets = [{ scale: "x", auto: true }, { scale: "y", auto: true }];
    this.loop = new uPlot({
      ...base, ...this.sizeOf(this.loopHost), mode: 2, axes: [{ ...base.axes[0], values: base.axes[1].values }, base.axes[1]],
      scales: { x: { time: false, range: () => this.loopRange?.[0] ?? [-1, 1] }, y: { range: () => this.loopRange?.[1] ?? [-1, 1] } },
      series: [null, ...this.axes.map(() => ({ facets, paths: draw }))],
    }, [null, ...this.axes.map(() => [[0], [0]])], this.loopHost);
  }

  show(axis, on) {
    if (on) this.shown.add(axis); else this.shown.delete(axis);
    this.traces.forEach((one) => one.show(axis, on));
    this.spectrum.setSeries(this.axes.indexOf(axis) + 1, { show: on });
  }

  columns() {
    return Math.max(100, Math.min(MOST_COLUMNS, document.getElementById("position").clientWidth - AXIS_WIDTH - 10));
  }

  draw(store) {
    this.traces.forEach((one) => one.draw(store));
  }

  drawSpectrum(frame) {
    this.spectrum.setData([frame.fHz, ...frame.amplitude.map((values) => values.map((v) => (v > 0 ? v : NaN)))]);
  }

  drawLoop(frame) {
    const nothing = [new Float32Array(0), new Float32Array(0)];
    const shown = this.axes.map((axis, i) => (this.shown.has(axis) && frame.pairs[i]) || nothing);
    const ends = [0, 1].map((side) => {
      let low = Infinity, high = -Infinity;
      for (const pair of shown) for (const value of pair[side]) { if (value < low) low = value; if (value > high) high = value; }
      return [low, high];
    });
    this.loopRange = ends.map(([low, high], i) => steady(this.loopRange?.[i], low, high));
    this.loop.setData([null, ...shown]);
  }
}
