// The settings of an axis: a field for each number, in the groups of the stage file. Only what was changed is sent.

import { at, made, numberOf } from "./elements.js";

const FIELDS = ["zeros_Hz", "zeros_zeta", "poles_Hz", "poles_zeta"];
// What a filter of each kind shows and begins with; `Hz` is the first mode of the model.
const KINDS = {
  none: { shown: [], start: () => [null, null, null, null] },
  notch: { shown: ["zeros_Hz", "zeros_zeta", "poles_zeta"], start: (Hz) => [Hz, 0.05, Hz, 0.5] },
  "low-pass": { shown: ["poles_Hz", "poles_zeta"], start: () => [0, 0, 800, 0.7] },
  "lead or lag": { shown: FIELDS, start: () => [100, 1, 400, 1] },
};
const LABELS = {
  notch: { zeros_Hz: "frequency, Hz", zeros_zeta: "damping of the zeros: how deep", poles_zeta: "damping of the poles: how wide" },
  "low-pass": { poles_Hz: "frequency, Hz", poles_zeta: "damping" },
};

function kindOf([zeros_Hz, , poles_Hz]) {
  if (poles_Hz === null) return "none";
  if (!zeros_Hz) return "low-pass";
  return zeros_Hz === poles_Hz ? "notch" : "lead or lag";
}

export class Settings {
  constructor(send) {
    this.send = send;
    this.form = at("settings");
    this.all = {};
    this.form.addEventListener("submit", (event) => { event.preventDefault(); this.save(); });
    this.form.addEventListener("reset", (event) => { event.preventDefault(); this.draw(); });
    this.form.elements.axis.addEventListener("change", () => this.draw());
  }

  update(all, model) {
    this.all = all ?? {};
    at("no-settings").hidden = Boolean(model);
    this.draw();
  }

  draw() {
    const axes = Object.keys(this.all), choice = this.form.elements.axis;
    const axis = axes.includes(choice.value) ? choice.value : axes[0];
    at("settings-of").hidden = axes.length === 0;
    choice.replaceChildren(...axes.map((one) => made("option", { selected: one === axis }, one)));
    const open = new Set([...at("settings-parts").children].filter((one) => one.open).map((one) => one.dataset.of));
    const rows = new Map();
    for (const row of this.all[axis] ?? []) rows.set(row.part, [...(rows.get(row.part) ?? []), row]);
    const first = [...(this.all[axis] ?? [])].find((row) => row.part.endsWith(".resonance") && row.name.startsWith("f_Hz"));
    const groups = [...rows].map(([part, own]) => {
      const effect = part.startsWith("effects."), of = part.replace(/\.\d+/, "");  // its number changes as others go
      const group = made("details", { class: "job", open: open.has(of) }, made("summary", {}, effect ? `Effect: ${own[0].title}` : own[0].title));
      group.dataset.of = of;
      if (part === "filters") group.append(...this.filters(own, Math.round(10 * (first?.value ?? 200)) / 10));
      else group.append(...own.map((row) => this.line(row)));
      if (effect) group.append(made("label", { class: "remove" }, made("input", { type: "checkbox", name: part }), "remove this effect from the model"));
      return group;
    });
    at("settings-parts").replaceChildren(...groups);
  }

  line(row) {
    const bounds = row.high != null ? ` (${row.low} to ${row.high})` : "";
    return made("div", { class: "line" }, made("label", { title: row.name }, `${row.name}: ${row.what}${bounds} `, this.input(row)));
  }

  input(row) {
    const value = row.value == null ? "" : Number(row.value.toPrecision(6));
    const input = made("input", { type: "number", step: "any", value, defaultValue: value, placeholder: "left out", name: `${row.part}.${row.name}` });
    if (row.high != null) [input.min, input.max] = [row.low, row.high];
    return input;
  }

  // Two places behind the PID, each with a kind; a notch has one frequency for its zeros and its poles.
  filters(rows, mode_Hz) {
    const places = new Map();
    for (const row of rows) {
      const place = row.name.split(".")[0];
      places.set(place, [...(places.get(place) ?? []), row]);
    }
    return [...places].map(([place, own]) => {
      const inputs = own.map((row) => this.input(row)), kind = kindOf(own.map((row) => row.value));
      const words = inputs.map(() => made("span")), lines = inputs.map((input, i) => made("div", { class: "line" }, made("label", {}, words[i], " ", input)));
      const select = made("select", { ariaLabel: `kind of filter ${Number(place) + 1}` }, ...Object.keys(KINDS).map((one) => made("option", { selected: one === kind }, one)));
      const show = (chosen) => FIELDS.forEach((name, i) => {
        lines[i].hidden = !KINDS[chosen].shown.includes(name);
        words[i].textContent = LABELS[chosen]?.[name] ?? own[i].what;
      });
      select.addEventListener("change", () => {
        KINDS[select.value].start(mode_Hz).forEach((value, i) => { inputs[i].value = value ?? ""; });
        show(select.value);
      });
      inputs[0].addEventListener("input", () => { if (select.value === "notch") inputs[2].value = inputs[0].value; });
      show(kind);
      return made("fieldset", { class: "filter" }, made("legend", {}, `Filter ${Number(place) + 1}`), select, ...lines);
    });
  }

  save() {
    const inputs = [...at("settings-parts").querySelectorAll("input")];
    const numbers = inputs.filter((one) => one.type === "number" && one.value !== one.defaultValue).map((one) => [one.name, numberOf(one)]);
    const removed = inputs.filter((one) => one.type === "checkbox" && one.checked).map((one) => [one.name, null]);
    const gone = new Set(removed.map(([name]) => name));
    const kept = numbers.filter(([name]) => ![...gone].some((one) => name.startsWith(`${one}.`)));
    return this.send("settings", { axis: this.form.elements.axis.value, values: Object.fromEntries([...kept, ...removed]) });
  }
}
