// The page: what is turned becomes a request, what is flown becomes a picture.

import { Stage } from "lab/arm.js";
import { Spectrum, Strip } from "lab/chart.js";
import { EVERY, Pilot, bytesOf } from "lab/engine.js";
import { OPTIONS, VIEW, defaults, pythonOf, readHash, scenarioOf, textOf, writeHash } from "lab/options.js";
import { spectrum } from "lab/spectrum.js";

const find = (id) => document.getElementById(id);
const data = (id) => find(id).textContent;

const POLICIES = JSON.parse(data("policies"));
const policyOf = (name) => POLICIES.find((policy) => policy.name === name);
const NOBODY = "nobody";
const TAIL = 8; // seconds of which the spectrum is shown

let state = readHash(location.hash);
let racers = []; // {flight, policy, colour, dash}, the first in front
let playing = false;
let ink = {};

// --- small things --------------------------------------------------------------------------------

function make(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

function toast(text) {
  find("toast").textContent = text;
  find("toast").classList.add("shown");
  clearTimeout(toast.timer);
  toast.timer = setTimeout(() => find("toast").classList.remove("shown"), 2200);
}

async function copy(text, said) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    // a page from a file may have no clipboard of its own
    const area = make("textarea", { value: text });
    (find("lines").open ? find("lines") : document.body).append(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
  toast(said);
}

function store(name, value) {
  try {
    if (value === undefined) return localStorage.getItem(name);
    localStorage.setItem(name, value);
  } catch {
    // without storage the page forgets it
  }
  return null;
}

const signed = (value, digits) => {
  if (!Number.isFinite(value)) return "—";
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−");
};

// --- colours -------------------------------------------------------------------------------------

function paint() {
  const dark = document.documentElement.dataset.theme === "dark";
  const of = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  ink = {
    ink: of("ink"), soft: of("soft"), grid: of("grid"), ring: of("ring"), spoke: dark ? "#18233680" : "#dbe4ee80", line: of("line"), card: of("card"),
    edge: dark ? "#05080d" : "#3b4657",
    tube1: dark ? "#5c6a80" : "#c3ccd8", tube2: dark ? "#7f8da3" : "#dde3eb",
    slew: dark ? "rgb(86 180 233 / 7%)" : "rgb(0 114 178 / 5%)",
  };
}

function theme(name) {
  document.documentElement.dataset.theme = name;
  paint();
  redraw();
}

// --- flying --------------------------------------------------------------------------------------

const pilots = [];
let asked = 0;

function requestOf(policy) {
  const scenario = scenarioOf(state);
  const request = { scenario, every: EVERY, seed: 0 };
  if (!policy.policy) return { ...request, law: policy.law };
  // the task that it was trained in, for the length of this flight
  const config = structuredClone(policy.policy.config);
  config.scenario.horizon = scenario.horizon ?? 20;
  return { ...request, policy: { ...policy.policy, config } };
}

async function fly() {
  const mine = ++asked;
  document.documentElement.dataset.state = "flying";
  writeAddress();
  const names = [state.a, state.b].filter((name) => name !== NOBODY);
  const unknown = names.find((name) => !policyOf(name));
  if (unknown !== undefined) {
    refuse(`nobody is called ${unknown}; there are ${POLICIES.map(({ name }) => name).join(", ")}`);
    return;
  }
  const policies = names.map(policyOf);
  const found = await Promise.all(policies.map((policy, k) => pilots[k].fly(requestOf(policy), policy.bytes)));
  if (mine !== asked || found.includes(null)) return;
  const refused = found.find((outcome) => outcome.refused);
  if (refused) {
    refuse(refused.refused);
    return;
  }
  find("refused").hidden = true;
  racers = found.map(({ flight }, k) => ({ flight, policy: policies[k], colour: policies[k].colour, dash: policies[k].dash }));
  const { horizon } = racers[0].flight.scenario;
  find("time").max = horizon;
  state.t = Math.min(state.t, horizon);
  cards();
  redraw();
  document.documentElement.dataset.state = "flown";
}

function refuse(text) {
  find("refused").textContent = text;
  find("refused").hidden = false;
  document.documentElement.dataset.state = "refused";
}

// --- what is seen --------------------------------------------------------------------------------

const stage = new Stage(find("arm"));
const strips = [];
let spectra;

function makeCharts() {
  const parent = find("charts");
  const add = (options) => strips.push(new Strip(parent, options, seek));
  const degrees = (value) => (value * 180) / Math.PI;
  add({ title: "Tip error", unit: "mm, where the tip is less where it should be", digits: 2, signal: ({ signals }, i) => 1e3 * signals.tip_error[i] });
  add({ title: "Tip deflection", unit: "mm", digits: 2, signal: ({ signals }, i) => 1e3 * signals.tip_deflection[i] });
  add({ title: "Torque of the root wheel", unit: "N m", digits: 1, signal: ({ signals }, i) => signals.root_torque[i],
    limits: ({ scenario }) => [scenario.root_wheel.torque_limit, -scenario.root_wheel.torque_limit] });
  add({ title: "Torque of the tip wheel", unit: "N m", digits: 2, signal: ({ signals }, i) => signals.tip_torque[i],
    limits: ({ scenario }) => [scenario.tip_wheel.torque_limit, -scenario.tip_wheel.torque_limit] });
  add({ title: "Slew angle", unit: "degrees; the reference is dashed", digits: 3, signal: ({ signals }, i) => degrees(signals.slew_angle[i]),
    reference: ({ signals }, i) => degrees(signals.reference_angle[i]) });
  spectra = new Spectrum(parent, "Spectrum of the tip deflection", `mm; the last ${TAIL} s; natural frequencies dashed`);
}

function cards() {
  const parent = find("cards");
  parent.replaceChildren(...racers.map(({ policy, colour }) => {
    const card = make("div", { className: "card" });
    card.style.setProperty("--of", colour);
    const gauge = (name) => `<div class="gauge"><span><span class="long">${name} </span>wheel</span><div class="bar"><i></i></div><output></output></div>`;
    card.innerHTML = `<h3><i class="dot"></i><span></span></h3><div class="numbers">
      <div><small>Tip error</small><b></b><span>mm</span></div><div><small>Deflection</small><b></b><span>mm</span></div></div>${gauge("Root")}${gauge("Tip")}`;
    card.querySelector("h3 span").textContent = policy.short;
    return card;
  }));
}

function now() {
  const i = Math.round(state.t / (EVERY * 0.002));
  racers.forEach(({ flight }, k) => {
    const j = Math.min(i, flight.samples - 1);
    const { signals, scenario } = flight;
    const card = find("cards").children[k];
    const [error, deflection] = card.querySelectorAll("b");
    const shown = (value) => signed(1e3 * value, Math.abs(value) < 0.1 ? 2 : 0);
    error.textContent = shown(signals.tip_error[j]);
    deflection.textContent = shown(signals.tip_deflection[j]);
    const wheels = [[signals.root_torque[j], scenario.root_wheel], [signals.tip_torque[j], scenario.tip_wheel]];
    card.querySelectorAll(".gauge").forEach((gauge, w) => {
      const [torque, { torque_limit: limit }] = wheels[w];
      const part = Math.max(-1, Math.min(1, torque / limit)) * 50;
      const bar = gauge.querySelector("i");
      bar.style.left = `${50 + Math.min(0, part)}%`;
      bar.style.width = `${Math.abs(part)}%`;
      gauge.querySelector("output").textContent = `${signed(torque, w ? 2 : 1)} N m`;
    });
  });
  return i;
}

let lastSpectrum = 0;

function draw(whole = false) {
  if (!racers.length) return;
  const i = now();
  stage.draw(racers, i, state.x, ink);
  strips.forEach((strip) => strip.seek(racers, state.t, i));
  find("time").value = state.t;
  find("clock").textContent = `${state.t.toFixed(2)} s`;
  const time = performance.now();
  if (whole || !playing || time - lastSpectrum > 90) {
    lastSpectrum = time;
    drawSpectrum(i);
  }
}

function drawSpectrum(i) {
  const rate = 1 / (EVERY * 0.002);
  const lines = racers.map(({ flight, colour, dash }) => {
    // at the start of a flight the first seconds, so that there is something to see
    const to = Math.min(Math.max(i, TAIL * rate), flight.samples);
    const from = Math.max(0, to - TAIL * rate);
    const found = spectrum(flight.signals.tip_deflection, from, to, rate);
    return { ...found, amplitude: found.amplitude.map((value) => 1e3 * value), colour, dash };
  });
  const { flight } = racers[0];
  const length = flight.signals.extension[Math.min(i, flight.samples - 1)];
  const { lengths, frequencies } = flight;
  const part = lengths[0] === lengths.at(-1) ? 0 : ((length - lengths[0]) / (lengths.at(-1) - lengths[0])) * (lengths.length - 1);
  const low = Math.min(Math.floor(part), lengths.length - 2);
  const marks = Array.from(frequencies[0], (_, k) => {
    const between = frequencies[low][k] + (frequencies[low + 1][k] - frequencies[low][k]) * (part - low);
    return between / (2 * Math.PI);
  });
  spectra.draw(lines, marks, ink);
}

function redraw() {
  if (!racers.length) return;
  const narrow = matchMedia("(max-width: 980px)").matches;
  stage.fit(racers.map(({ flight }) => flight), narrow ? 0 : 250);
  table(narrow);
  const duration = racers[0].flight.scenario.horizon;
  strips.forEach((strip) => strip.draw(racers, duration, ink));
  const factor = stage.factor(state.x);
  find("scale").innerHTML = narrow ? `Deflection drawn <b>×${factor}</b>`
    : `Deflections are drawn <b>${factor === 1 ? "to scale" : `${factor} times as large`}</b>; dashed: the reference; rings: 5 m`;
  draw(true);
}

const mm = (value) => 1e3 * value;
const METRICS = [
  { name: "tip_error_rms", label: "Tip error, RMS", unit: "mm", si: mm, digits: 3 },
  { name: "peak_deflection", label: "Largest deflection", unit: "mm", si: mm, digits: 2 },
  { name: "residual_rms", label: "Vibration after the slew", unit: "mm RMS", si: mm, digits: 3 },
  { name: "settling_time", label: "Settled after the slew", unit: "s", si: (v) => v, digits: 2 },
  { name: "final_slew_error", label: "Slew error at the end", unit: "mrad", si: mm, digits: 3 },
  { name: "overshoot", label: "Overshoot", unit: "mrad", si: mm, digits: 2 },
  { name: "residual_energy", label: "Energy left", unit: "mJ", si: mm, digits: 2 },
  { name: "wheel_effort", label: "Effort of the wheels", unit: "s", si: (v) => v, digits: 2 },
  { name: "saturation", label: "At a wheel's limit", unit: "% of time", si: (v) => 100 * v, digits: 1 },
];

/** Decimals with which a number has about five digits. */
const fitting = (value) => Math.max(0, 4 - Math.floor(Math.log10(Math.max(Math.abs(value), 1))));

/** The metrics that are shown: their texts, one a racer, and which racer's is the smallest, if one is. */
function results() {
  return METRICS.map(({ name, label, unit, si, digits }) => {
    const values = racers.map(({ flight }) => si(flight.metrics[name]));
    const sizes = values.map((value) => (Number.isNaN(value) ? Infinity : Math.abs(value)));
    const differ = sizes.length > 1 && sizes[0].toFixed(digits) !== sizes[1].toFixed(digits);
    const never = name === "settling_time" ? "not yet" : "—";
    return {
      label, unit, best: differ ? sizes.indexOf(Math.min(...sizes)) : -1,
      texts: values.map((value) => (Number.isNaN(value) ? never : signed(value, Math.min(digits, fitting(value))))),
    };
  });
}

/** The table: a row a racer where there is room, else a row a metric. */
function table(narrow) {
  const named = results().map((result) => ({
    ...result, head: () => make("th", { scope: narrow ? "row" : "col" }, `${result.label} `, make("small", { textContent: result.unit })),
    cell: (k) => make("td", { textContent: result.texts[k], className: k === result.best ? "best" : "" }),
  }));
  const racer = ({ policy, colour }) => {
    const dot = make("i", { className: "dot" });
    dot.style.setProperty("--of", colour);
    return make("th", { scope: narrow ? "col" : "row" }, dot, ` ${policy.short}`);
  };
  const rows = narrow
    ? named.map(({ head, cell }) => make("tr", {}, head(), ...racers.map((_, k) => cell(k))))
    : racers.map((one, k) => make("tr", {}, racer(one), ...named.map(({ cell }) => cell(k))));
  const top = narrow ? racers.map(racer) : named.map(({ head }) => head());
  find("metrics").replaceChildren(make("thead", {}, make("tr", {}, make("td"), ...top)), make("tbody", {}, ...rows));
  const lost = racers.filter(({ flight }) => flight.metrics.diverged === 1);
  const lines = racers.map(({ flight, policy }) => {
    const factor = (1e3 * flight.metrics.duration) / flight.milliseconds;
    return `${policy.short} in ${flight.milliseconds.toFixed(0)} ms, ${factor.toFixed(0)} times real time`;
  });
  const said = lost.map(({ policy, flight }) => `${policy.title} left the limits of the equations after ${flight.metrics.duration.toFixed(2)} s. `);
  find("speedometer").textContent = `${said.join("")}★ the smaller one, over the whole flight. Flown in this browser: ${lines.join("; ")}.`;
}

// --- what is turned ------------------------------------------------------------------------------

const updates = [];

function control(option) {
  const field = make("div", { className: "field" });
  const id = `option-${option.key}`;
  const head = make("div", { className: "head" });
  if (option.choices) {
    head.append(make("span", { textContent: option.label, id: `${id}-label` }));
    const choices = make("div", { className: "choices", role: "radiogroup" });
    choices.setAttribute("aria-labelledby", `${id}-label`);
    for (const [value, text] of option.choices) {
      const input = make("input", { type: "radio", name: id, value });
      input.addEventListener("change", () => turn(option.key, value));
      choices.append(make("label", {}, input, text));
      updates.push(() => { input.checked = state[option.key] === value; });
    }
    field.append(head, choices);
    return field;
  }
  const output = make("output", { htmlFor: id });
  head.append(make("label", { htmlFor: id, textContent: option.label }), output);
  const input = make("input", { type: "range", id, min: option.from, max: option.to, step: option.step });
  input.addEventListener("input", () => turn(option.key, Number(input.value)));
  updates.push(() => {
    if (typeof state[option.key] === "number") input.value = state[option.key];
    output.textContent = textOf(option, state[option.key], state);
  });
  field.append(head, input);
  return field;
}

function makeControls() {
  for (const option of OPTIONS) find(option.basic ? "controls" : "more").append(control(option));
  for (const [key, label] of [["a", "Flies"], ["b", "Races it"]]) {
    const dot = make("i", { className: "dot" });
    const select = make("select", { id: `pilot-${key}` });
    select.setAttribute("aria-label", label);
    for (const { name, title } of POLICIES) select.append(make("option", { value: name, textContent: title }));
    if (key === "b") select.append(make("option", { value: NOBODY, textContent: "nobody" }));
    select.addEventListener("change", () => {
      const other = key === "a" ? "b" : "a";
      if (state[other] === select.value) state[other] = state[key];
      turn(key, select.value);
    });
    updates.push(() => {
      select.value = state[key];
      dot.style.setProperty("--of", policyOf(state[key])?.colour ?? "transparent");
    });
    find("pilots").append(make("div", { className: "pilot" }, dot, select));
  }
  const factor = { key: "x", label: "Deflections drawn", unit: "times as large", from: 1, to: 300, step: 1 };
  const field = control(factor);
  find("view").append(field);
}

function turn(key, value) {
  state[key] = value;
  update();
  if (key in VIEW && key !== "a" && key !== "b") redraw();
  else fly();
  writeAddress();
}

function update() {
  updates.forEach((change) => change());
}

let address = location.hash; // as it was taken up or written last

function writeAddress() {
  clearTimeout(writeAddress.timer);
  writeAddress.timer = setTimeout(() => {
    if (location.hash !== address) return; // another has been typed meanwhile, and will be taken up
    const text = writeHash({ ...state, t: Number(state.t.toFixed(2)) });
    if (location.hash.slice(1) !== text) history.replaceState(null, "", text ? `#${text}` : location.pathname + location.search);
    address = location.hash;
  }, 150);
}

// --- time ----------------------------------------------------------------------------------------

const horizon = () => racers[0]?.flight.scenario.horizon ?? 20;

function seek(time) {
  state.t = Math.min(Math.max(time, 0), horizon());
  draw();
  if (!playing) writeAddress();
}

function play(on) {
  playing = on;
  find("play").textContent = on ? "❚❚" : "▶";
  find("play").setAttribute("aria-pressed", String(on));
  if (!on) {
    draw(true);
    writeAddress();
    return;
  }
  if (state.t >= horizon() - 1e-9) state.t = 0;
  let before = performance.now();
  const step = (instant) => {
    if (!playing) return;
    seek(state.t + ((instant - before) / 1e3) * Number(find("speed").value));
    before = instant;
    if (state.t >= horizon()) play(false);
    else requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}

function key(event) {
  if (find("lines").open || event.ctrlKey || event.metaKey || event.altKey) return;
  const within = event.target;
  const takes = within.matches?.("select, input[type=radio], input[type=range]:not(#time), summary, textarea");
  if (event.key === " " && !within.matches?.("button, summary, select")) play(!playing);
  else if (takes) return;
  else if (event.key === "ArrowRight" || event.key === "ArrowLeft") {
    seek(state.t + (event.shiftKey ? 1 : 0.05) * (event.key === "ArrowRight" ? 1 : -1));
  } else if (event.key === "Home") seek(0);
  else if (event.key === "End") seek(horizon());
  else return;
  event.preventDefault();
}

// --- beginning -----------------------------------------------------------------------------------

function pythonLines() {
  const policies = [state.a, state.b].filter((name) => name !== NOBODY).map(policyOf).filter(Boolean);
  return pythonOf(scenarioOf(state), policies);
}

async function begin() {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  theme(store("drm-lab-theme") ?? (dark.matches ? "dark" : "light"));
  dark.addEventListener("change", () => { if (!store("drm-lab-theme")) theme(dark.matches ? "dark" : "light"); });
  makeControls();
  makeCharts();
  update();
  find("theme").onclick = () => {
    const other = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
    store("drm-lab-theme", other);
    theme(other);
  };
  find("play").onclick = () => play(!playing);
  find("time").oninput = () => {
    const to = Number(find("time").value);
    play(false);
    seek(to);
  };
  find("reset").onclick = () => {
    state = { ...defaults(), engine: state.engine };
    update();
    fly();
  };
  find("link").onclick = () => {
    const text = writeHash({ ...state, t: Number(state.t.toFixed(2)) });
    copy(location.href.split("#")[0] + (text ? `#${text}` : ""), "The link is copied.");
  };
  find("python").onclick = () => {
    find("code").textContent = pythonLines();
    find("lines").showModal();
  };
  find("copy").onclick = () => copy(find("code").textContent, "The lines are copied.");
  find("close").onclick = () => find("lines").close();
  addEventListener("keydown", key);
  addEventListener("hashchange", () => {
    address = location.hash;
    state = readHash(address);
    update();
    fly();
  });
  new ResizeObserver(() => redraw()).observe(find("arm").parentElement);
  try {
    const [portable, fast] = await Promise.all([bytesOf(data("module-portable"), true), bytesOf(data("module-relaxed"), true)]);
    for (const policy of POLICIES) if (policy.weights) policy.bytes = await bytesOf(policy.weights);
    const modules = { portable, fast: state.engine === "portable" ? null : fast };
    pilots.push(new Pilot(data("worker"), modules), new Pilot(data("worker"), modules));
    document.documentElement.dataset.engine = await pilots[0].module;
    await pilots[1].module;
  } catch (error) {
    refuse(`this browser cannot run the lab: ${error.message}`);
    return;
  }
  await fly();
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  if (!location.hash && !still && racers.length) play(true);
}

// for tests, and for whoever opens the console
window.drmLab = {
  get flights() { return racers.map(({ flight, policy }) => ({ policy: policy.name, ...flight })); },
  get state() { return { ...state }; },
  get scenario() { return scenarioOf(state); },
  pythonLines,
};

begin();
