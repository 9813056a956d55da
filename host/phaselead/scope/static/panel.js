// The controls beside the traces: what they ask for, and what the hub says of itself.

import { at, made, numberOf } from "./elements.js";
import { Settings } from "./settings.js";

// Formats of the device: Kp and Kd/Ts have 7 bits before the point, Ki Ts has none.
const GAINS = [["Kp", "V/µm", 127], ["Ki", "V/(µm s)", 2499], ["Kd", "V s/µm", 0.0255]];

export class Panel {
  constructor(link, axes) {
    this.link = link;
    this.axes = axes;
    this.state = {};
    this.fields();
    this.actions();
  }

  fields() {
    const labelled = (axis, ...children) => made("div", { class: "row" }, made("b", { style: `color: var(--${axis})` }, axis), ...children);
    this.targets = {};
    this.waves = {};
    this.gains = {};
    this.readouts = {};
    for (const axis of this.axes) {
      const target = (this.targets[axis] = made("input", { type: "number", step: "any", placeholder: "µm", ariaLabel: `target of ${axis}, µm` }));
      const step = (sign) => made("button", { type: "button", class: "drives", ariaLabel: `${axis} by ${sign} one step`,
        onclick: () => this.order("move", { targets: { [axis]: `${sign}${at("step").value}um` }, ...this.how() }) }, sign);
      at("targets").append(labelled(axis, step("-"), target, step("+")));
      const wave = (this.waves[axis] = made("input", { placeholder: axis === "x" ? "sine:40um@5Hz" : "at rest", ariaLabel: `waveform of ${axis}` }));
      wave.setAttribute("list", "shapes");
      at("waves").append(labelled(axis, wave));
      this.gains[axis] = GAINS.map(([name, unit, most]) => made("input", { type: "number", min: 0, max: most, step: "any", placeholder: name, title: `${name}, ${unit}`, ariaLabel: `${name} of ${axis}, ${unit}` }));
      at("gains").append(labelled(axis, ...this.gains[axis]));
      const value = made("b"), small = made("small");
      this.readouts[axis] = { value, small };
      at("readouts").append(made("div", { class: "readout", style: `color: var(--${axis})` }, value, small));
      at("trigger").elements.axis.append(made("option", {}, axis));
    }
    const shapes = ["sine:40um@5Hz", "triangle:60um@10Hz", "square:10um@2Hz", "staircase:60um@1Hz", "sine:40um+20um@5Hz", "sine:4V@5Hz"];
    document.body.append(made("datalist", { id: "shapes" }, ...shapes.map((value) => made("option", { value }))));
  }

  how() {
    const gains = {};
    for (const axis of this.axes) {
      const values = this.gains[axis].map((input) => input.value);
      if (values.some((value) => value !== "")) gains[axis] = values.map((value) => value || "0").join(",");
    }
    return { mode: at("mode").value, gains };
  }

  texts(inputs, unit = "") {
    const given = Object.entries(inputs).filter(([, input]) => input.value !== "");
    return Object.fromEntries(given.map(([axis, input]) => [axis, input.value + unit]));
  }

  async order(order, given = {}) {
    const reply = await this.link.ask({ order, ...given });
    this.alert(reply.ok ? "" : reply.said);
    return reply;
  }

  alert(words) {
    at("alert").textContent = words;
    at("alert").hidden = !words;
  }

  actions() {
    const submits = (id, act) => at(id).addEventListener("submit", (event) => { event.preventDefault(); act(event.target.elements); });
    for (const button of document.querySelectorAll("[data-order]")) button.addEventListener("click", () => this.order(button.dataset.order));
    at("stop").addEventListener("click", () => this.link.stop());
    document.addEventListener("keydown", (event) => {
      if (event.code !== "Space" || event.target.matches("input:not([type=number]):not([type=checkbox])")) return;
      event.preventDefault();
      if (!event.repeat) this.link.stop();
    }, true);
    document.addEventListener("keyup", (event) => event.code === "Space" && event.target.matches("button") && event.preventDefault(), true);
    at("take").addEventListener("click", () => this.link.ask({ take: true }).then((reply) => this.alert(reply.ok ? "" : reply.said)));
    submits("set-points", () => this.order("move", { targets: this.texts(this.targets, "um"), duration: numberOf(at("duration")), ...this.how() }));
    submits("waveforms", () => this.order("play", { waves: this.texts(this.waves), ...this.how() }));
    submits("how", () => this.checkGains());
    at("check").addEventListener("click", () => this.checkGains());
    at("upload").addEventListener("click", () => this.order("model", { path: at("model-path").value }));
    this.settings = new Settings((order, given) => this.order(order, given));
    submits("trigger", (form) => this.order("trigger", {
      run: form.run.value, axis: form.axis.value, trace: form.trace.value, edge: form.edge.value,
      level: numberOf(form.level), before: numberOf(form.before) / 100, window_s: numberOf(form.window_s),
    }));
    submits("saving", (form) => this.order("save", { name: form.name.value, seconds: numberOf(form.seconds) }));
  }

  async checkGains() {
    const { gains } = this.how();
    for (const axis of Object.keys(gains).length ? Object.keys(gains) : this.axes.slice(0, 1)) {
      if (!(await this.order("loop", { axis, gains })).ok) return;
    }
  }

  jobs(jobs) {
    at("jobs").querySelectorAll(".job").forEach((one) => one.remove());
    for (const job of jobs) {
      const inputs = job.fields.map((field) => made("input", { name: field.name, value: field.default, placeholder: field.hint, title: field.hint }));
      const form = made("form", {}, made("p", { class: "hint" }, job.what),
        ...inputs.map((input, i) => made("div", { class: "line" }, made("label", {}, job.fields[i].label, " ", input))),
        made("div", { class: "line" }, made("button", { class: "drives primary" }, `Start ${job.title.toLowerCase()}`)));
      form.addEventListener("submit", (event) => {
        event.preventDefault();
        this.order(job.name, Object.fromEntries(inputs.map((input) => [input.name, input.value])));
      });
      at("jobs").append(made("details", { class: "job" }, made("summary", {}, job.title), form));
    }
  }

  gone() {
    this.update({ state: "no scope", drives: false });
    this.alert("The scope does not answer. Was it ended? The device parks by itself within a second.");
    this.lost = true;
  }

  update(changed) {
    if (this.lost && !("drives" in changed && changed.drives === false && changed.state === "no scope")) {
      this.lost = false;
      this.alert("");
    }
    const state = Object.assign(this.state, changed);
    at("port").textContent = at("port").title = state.port ?? "";
    at("state").textContent = state.job ? state.job.name : state.state;
    at("state").dataset.state = state.state;
    at("drops").textContent = `${state.dropped ?? 0} dropped`;
    at("drops").classList.toggle("some", state.dropped > 0);
    at("who").textContent = state.drives ? "" : "looks on";
    at("take").hidden = !state.may_take || state.drives;
    for (const button of document.querySelectorAll("button.drives")) button.disabled = !state.drives || Boolean(state.away) || Boolean(state.job);
    if ("away" in changed && changed.away) this.alert(`${changed.away}. Looking for it.`);
    else if ("away" in changed || "fault" in changed) this.alert(state.fault ?? "");
    for (const [axis, one] of Object.entries(state.axes ?? {})) {
      const read = this.readouts[axis];
      if (!read) continue;
      read.value.textContent = `${one.x_um.toFixed(2)} µm`;
      const doing = one.on_target ? "on target" : one.moving ? "moving" : one.held ? "held" : "";
      read.small.textContent = `${one.u_V.toFixed(3)} V${one.held && !one.moving ? `, to ${one.target_um.toFixed(2)}` : ""} ${doing}`;
    }
    for (const [axis, limits] of Object.entries(state.limits ?? {})) {
      if (this.targets[axis]) [this.targets[axis].min, this.targets[axis].max] = limits.x_um;
    }
    at("model").textContent = state.model ? `model: ${state.model.name} (${state.model.axes.join(", ")})` : "no model: pid with the paper's gains";
    if ("settings" in changed || "model" in changed) this.settings.update(state.settings, state.model);
    at("waiting").textContent = state.trigger && state.trigger.run !== "off" ? (state.trigger.waiting ? "waiting" : "fired") : "";
    at("job").hidden = !state.job;
    if (state.job) {
      at("job").querySelector("progress").value = state.job.share;
      at("job").querySelector("span").textContent = `${state.job.name}: ${Math.round(100 * state.job.share)} %; STOP ends it`;
    }
    if ("lines" in changed) {
      const lines = state.lines.map(([time, kind, words]) => made("li", { class: kind }, made("time", {}, time), words));
      at("lines").replaceChildren(...lines.reverse());
    }
    if ("files" in changed) {
      const linked = (names) => names.map((name) => made("li", {}, made("a", { href: `/files/${encodeURIComponent(name)}`, target: "_blank" }, name)));
      const pages = state.files.filter((name) => name.endsWith(".html"));
      at("files").replaceChildren(...linked(state.files.filter((name) => !pages.includes(name))));
      at("page-list").replaceChildren(...linked(pages.reverse()));
      at("pages").hidden = pages.length === 0;
    }
  }
}
