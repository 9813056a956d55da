// Puts link, figures and panel together, and draws once for each frame of the screen.

import { at } from "./elements.js";
import { COLUMNS, Link, SPECTRUM } from "./link.js";
import { Panel } from "./panel.js";
import { Figures, Store } from "./plots.js";

const TRACES = 6;
let panel, figures, store, fresh = false, paused = false, drawn = 0;
const slow = {};

function view() {
  if (!figures) return;
  const columns = figures.columns();
  link.ask({ view: { window_s: Number(at("window").value), columns, spectrum: at("spectrum-of").value, loop: at("loop-of").value } });
}

function welcome({ axes, jobs }) {
  const letters = [...axes];
  if (!panel) {
    panel = new Panel(link, letters);
    let wait;
    figures = new Figures(letters, () => { clearTimeout(wait); wait = setTimeout(view, 200); });
    for (const axis of letters) {
      const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: true });
      const label = Object.assign(document.createElement("label"), { style: `color: var(--${axis})` });
      box.addEventListener("change", () => figures.show(axis, box.checked));
      label.append(box, ` ${axis}`);
      at("axes").append(label);
    }
    requestAnimationFrame(draw);
  }
  store = new Store(letters.length, TRACES);
  panel.jobs(jobs);
  view();
}

function framed(frame) {
  if (paused || !store) {
    link.seen();
    return;
  }
  if (frame.kind === COLUMNS) {
    const columns = Math.max(16, Math.ceil(Number(at("window").value) * 5000 / frame.ticks));
    store.add(frame, columns);
    fresh = true;
  } else slow[frame.kind] = frame;
}

function draw() {
  if (fresh) {
    fresh = false;
    figures.draw(store);
    link.seen();
    drawn++;
  }
  for (const [kind, frame] of Object.entries(slow)) {
    delete slow[kind];
    if (Number(kind) === SPECTRUM) figures.drawSpectrum(frame); else figures.drawLoop(frame);
  }
  requestAnimationFrame(draw);
}

function pause(on) {
  paused = on;
  at("pause").textContent = on ? "Go on" : "Pause";
  if (!on) view();
}

// A fault stays in view until somebody goes on.
function stated(changed) {
  if (changed.state === "fault") pause(true);
  panel?.update(changed);
}

const link = new Link({
  onFrame: framed,
  onWelcome: welcome,
  onState: stated,
  onGone: () => panel?.gone(),
});
for (const id of ["window", "spectrum-of", "loop-of"]) at(id).addEventListener("change", view);
at("pause").addEventListener("click", () => pause(!paused));
setInterval(() => {
  at("rate").textContent = paused ? "paused" : `${drawn} frames a second`;
  drawn = 0;
}, 1000);
