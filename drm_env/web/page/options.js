// What a visitor can turn: the page's state, its form in the address, and the scenario that it stands for.

const degrees = (value) => (value * Math.PI) / 180;

/**
 * Every option by its key in the address. `path` is its place in the scenario and `si` takes the value there;
 * `start` is the engine's default, `first` what the page begins with, if it is another.
 */
export const OPTIONS = [
  { key: "mass", path: "payload.mass", label: "Payload", unit: "kg", start: 200, from: 0, to: 1000, step: 5, basic: true },
  { key: "error", path: "mass_error", label: "Reported mass", unit: "%", start: 0, first: 10, from: -50, to: 50, step: 1, basic: true,
    si: (value) => value / 100, shown: (value, all) => `${sign(value)} % (${((1 + value / 100) * all.mass).toFixed(0)} kg)` },
  { key: "profile", path: "slew.profile", label: "Slew profile", start: "min_time", basic: true,
    choices: [["min_time", "Minimum time"], ["min_energy", "Minimum energy"]] },
  { key: "smoothing", path: "slew.smoothing", label: "Smoothing of the profile", unit: "", start: 0, from: 0, to: 0.24, step: 0.01, digits: 2, basic: true },
  { key: "angle", path: "slew.angle", label: "Slew angle", unit: "°", start: 50, from: 5, to: 120, step: 1, si: degrees, basic: true },
  { key: "mode", path: "deployment.mode", label: "Extension", start: "coincident", basic: true,
    choices: [["coincident", "With slew"], ["force_limited", "By force"], ["none", "Fixed"]] },
  { key: "from", path: "deployment.start", label: "Length of link 2 at the start", unit: "m", start: 1, from: 1, to: 8, step: 0.1, digits: 1, basic: true },
  { key: "to", path: "deployment.end", label: "Length of link 2 at the end", unit: "m", start: 8, from: 1, to: 8, step: 0.1, digits: 1, basic: true },
  { key: "plant", path: "plant", label: "Plant (equations of motion)", start: "thesis", basic: true,
    choices: [["thesis", "Thesis"], ["consistent", "Consistent"]] },
  { key: "accel", path: "slew.max_accel", label: "Slew acceleration", unit: "rad/s²", start: 0.02, from: 0.005, to: 0.06, step: 0.001, digits: 3 },
  { key: "root", path: "root_wheel.torque_limit", label: "Limit of the root wheel", unit: "N m", start: 100, from: 5, to: 400, step: 5 },
  { key: "tip", path: "tip_wheel.torque_limit", label: "Limit of the tip wheel", unit: "N m", start: 10, from: 0.5, to: 40, step: 0.5, digits: 1 },
  { key: "damping", path: "dynamics.structural_damping", label: "Structural damping", unit: "ms", start: 0, from: 0, to: 5, step: 0.1, digits: 1, si: (value) => value / 1000 },
  { key: "noise", path: "sensors.rate_noise", label: "Noise of the slew rate", unit: "mrad/s", start: 0, from: 0, to: 2, step: 0.05, digits: 2, si: (value) => value / 1000 },
  { key: "delay", path: "sensors.delay", label: "Delay of the sensors", unit: "ms", start: 0, from: 0, to: 100, step: 2, si: (value) => value / 1000 },
  { key: "horizon", path: "horizon", label: "Length of the flight", unit: "s", start: 20, from: 10, to: 60, step: 1 },
];

/** The rest of the state: who flies, and how it is looked at. */
export const VIEW = { a: "dagger", b: "linear", t: 0, x: 100, engine: "" };

function sign(value) {
  return `${value > 0 ? "+" : value < 0 ? "−" : "±"}${Math.abs(value)}`;
}

export function textOf(option, value, all) {
  if (typeof value !== "number") return String(value);
  return option.shown ? option.shown(value, all) : `${value.toFixed(option.digits ?? 0)}${option.unit === "°" ? "" : " "}${option.unit}`;
}

export function defaults() {
  return { ...Object.fromEntries(OPTIONS.map(({ key, start, first }) => [key, first ?? start])), ...VIEW };
}

/** The state in an address. What is no number stays text: the engine says what is wrong with it. */
export function readHash(hash) {
  const state = defaults();
  for (const [key, text] of new URLSearchParams(hash.replace(/^#/, ""))) {
    if (!(key in state)) continue;
    const number = Number(text);
    state[key] = typeof state[key] === "number" && text.trim() !== "" && Number.isFinite(number) ? number : text;
  }
  return state;
}

export function writeHash(state) {
  const start = defaults();
  const parts = Object.entries(state).filter(([key, value]) => value !== start[key]);
  return new URLSearchParams(parts.map(([key, value]) => [key, String(value)])).toString();
}

/** The parts of the scenario that are not the engine's defaults. */
export function scenarioOf(state) {
  const scenario = {};
  for (const { key, path, start, si } of OPTIONS) {
    const value = state[key];
    if (value === start) continue;
    const names = path.split(".");
    const last = names.pop();
    const place = names.reduce((parts, name) => (parts[name] ??= {}), scenario);
    place[last] = si && typeof value === "number" ? si(value) : value;
  }
  return scenario;
}

const python = (value, indent = "") => {
  if (value === null) return "None";
  if (typeof value !== "object") return JSON.stringify(value);
  const inner = `${indent}    `;
  const rows = Object.entries(value).map(([name, part]) => `${inner}${JSON.stringify(name)}: ${python(part, inner)},`);
  return rows.length ? `{\n${rows.join("\n")}\n${indent}}` : "{}";
};

/** The lines that fly the same in Python. */
export function pythonOf(scenario, policies) {
  const isPlain = ({ law }) => typeof law === "string";
  const variable = ({ name }) => (name === "none" ? "open_loop" : name);
  const call = (policy) => (isPlain(policy)
    ? `drm_env.simulate(scenario, law="${policy.law}")`
    : `pilot_named("${policy.name}").trajectory(scenario)`);
  return [
    ...(policies.some(isPlain) ? ["import drm_env"] : []),
    ...(policies.every(isPlain) ? [] : ["from drm_baselines.policies.pilots import pilot_named"]),
    "",
    `scenario = ${python(scenario)}`,
    ...policies.map((policy) => `${variable(policy)} = ${call(policy)}`),
    ...policies.map((policy) => `print("${variable(policy)}", ${variable(policy)}.metrics["tip_error_rms"], "m")`),
    "",
  ].join("\n");
}
