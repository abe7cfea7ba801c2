// Flights: the arm at an instant, and charts of signals that share one cursor, one instant and one range of time.
"use strict";
(() => {
  const { element, mark, shown } = drm;
  const FACTORS = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000];
  const MOST_DRAWN = 1 / 6; // of the reach: the largest deflection that is drawn
  const POSSIBLE = 0.25; // of the reach: the largest deflection that an arm can have
  const PIECES = 24;
  // charts whose scale can be logarithmic away from zero, and up to where it is linear
  const BENT = { tip_error: 1, tip_deflection: 1, slew_error: 0.01 };
  const MARGIN = 26;
  const phi = (u) => (3 - u) * u * u;

  const bentRange = (low, high, level) => {
    const [a, b] = [Math.asinh(low / level), Math.asinh(high / level)];
    const pad = Math.max(0.1, 0.06 * (b - a));
    return [level * Math.sinh(a - pad), level * Math.sinh(b + pad)];
  };
  /** Zero and powers of ten on both sides of it. */
  const bentTicks = (low, high, level) => {
    const found = [0];
    for (let size = level; size <= Math.max(-low, high); size *= 10) found.push(size, -size);
    const inside = found.filter((tick) => tick >= low && tick <= high).sort((a, b) => a - b);
    return inside.length > 2 ? inside : null;
  };

  /** The arms of a manoeuvre: geometry and drawing. */
  class Arms {
    constructor(manoeuvre) {
      this.manoeuvre = manoeuvre;
      this.count = manoeuvre.intervals + 1;
      const [l1, l2] = manoeuvre.links;
      this.flights = manoeuvre.flights.map((flight) => {
        const all = drm.numbers(flight.arm);
        const [angle, extension, alpha, beta, tip] = Array.from({ length: 5 }, (_, k) => all.subarray(k * this.count, (k + 1) * this.count));
        return { ...flight, angle, extension, alpha, beta, tip, last: 0 };
      });
      this.reference = drm.numbers(manoeuvre.reference);
      this.reach = l1;
      let largest = 0;
      for (const flight of this.flights) {
        const end = Math.floor((flight.end / manoeuvre.duration) * (this.count - 1) + 1e-6);
        for (let i = 0; i <= end; i++) {
          const reach = l1 + flight.extension[i];
          if (!(Math.abs(flight.tip[i]) <= POSSIBLE * reach) || !Number.isFinite(flight.angle[i])) break;
          flight.last = i;
          this.reach = Math.max(this.reach, reach);
          largest = Math.max(largest, Math.abs(flight.tip[i]), Math.abs(2 * flight.alpha[i]));
        }
      }
      this.most = largest > 0 ? (MOST_DRAWN * this.reach) / largest : Infinity;
      const box = { x0: -1, x1: 1, y0: -1, y1: 1 };
      for (const flight of this.flights) {
        for (let i = 0; i <= flight.last; i++) {
          for (const angle of [flight.angle[i], this.reference[i]]) {
            const reach = l1 + flight.extension[i] + 1.1;
            box.x0 = Math.min(box.x0, reach * Math.cos(angle));
            box.x1 = Math.max(box.x1, reach * Math.cos(angle));
            box.y0 = Math.min(box.y0, reach * Math.sin(angle));
            box.y1 = Math.max(box.y1, reach * Math.sin(angle));
          }
        }
      }
      this.box = box;
      this.hidden = l2;
    }

    /** The factor that is drawn where `wanted` would bend the arm too far. */
    factor(wanted) {
      return Math.max(1, Math.min(wanted, this.most));
    }

    index(time) {
      return Math.min(this.count - 1, Math.round((time / this.manoeuvre.duration) * (this.count - 1)));
    }

    /** Height over width of what has to be seen. */
    get shape() {
      return (this.box.y1 - this.box.y0) / (this.box.x1 - this.box.x0);
    }

    draw(canvas, flights, time, wanted) {
      const { clientWidth: width, clientHeight: height } = canvas;
      if (!width || !height) return;
      const ratio = window.devicePixelRatio || 1;
      if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
        [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
      }
      const c = canvas.getContext("2d");
      c.setTransform(ratio, 0, 0, ratio, 0, 0);
      c.clearRect(0, 0, width, height);
      [c.lineJoin, c.lineCap] = ["round", "round"];
      const { x0, x1, y0, y1 } = this.box;
      const top = MARGIN + 22;
      const scale = Math.min((width - 2 * MARGIN) / (x1 - x0), (height - MARGIN - top) / (y1 - y0));
      const left = MARGIN + (width - 2 * MARGIN - scale * (x1 - x0)) / 2 - scale * x0;
      const down = top + (height - MARGIN - top - scale * (y1 - y0)) / 2 + scale * y1;
      const at = ([x, y]) => [left + scale * x, down - scale * y];
      const line = (points, thickness, colour, dash = []) => {
        c.beginPath();
        points.forEach((point, k) => c[k ? "lineTo" : "moveTo"](...at(point)));
        c.lineWidth = thickness;
        c.strokeStyle = colour;
        c.setLineDash(dash);
        c.stroke();
        c.setLineDash([]);
      };
      const along = (r, angle, side = 0) => [r * Math.cos(angle) - side * Math.sin(angle), r * Math.sin(angle) + side * Math.cos(angle)];
      const ink = Object.fromEntries(["ring", "soft", "edge", "tube", "card", "ink"].map((name) => [name, drm.colour(name)]));

      // rings of five metres, the target
      c.font = "11px system-ui, sans-serif";
      c.fillStyle = ink.soft;
      c.textAlign = "center";
      for (let radius = 5; radius <= this.reach + 4; radius += 5) {
        c.beginPath();
        c.arc(...at([0, 0]), radius * scale, 0, 2 * Math.PI);
        c.lineWidth = 1;
        c.strokeStyle = ink.ring;
        c.stroke();
        const [x, y] = at([radius, 0]);
        if (y + 16 < height && x < width - 12) c.fillText(`${radius} m`, x, y + 16);
      }
      line([along(0.9, this.manoeuvre.target), along(this.reach + 1.4, this.manoeuvre.target)], 1.2, ink.soft, [7, 6]);

      // the rigid arm that follows the reference
      const now = this.index(time);
      const reach = this.manoeuvre.links[0] + flights.reduce((most, flight) => Math.max(most, flight.extension[Math.min(now, flight.last)]), 0);
      line([[0, 0], along(reach, this.reference[now])], 1.6, ink.ink, [3, 5]);

      const factor = this.factor(wanted);
      flights.forEach((flight, k, { length }) => {
        c.globalAlpha = k === length - 1 ? 1 : 0.72;
        this.#arm({ c, at, line, scale, ink }, flight, Math.min(now, flight.last), factor);
      });
      c.globalAlpha = 1;
      c.beginPath();
      c.arc(...at([0, 0]), Math.max(8, 0.55 * scale), 0, 2 * Math.PI);
      c.fillStyle = ink.edge;
      c.fill();
      c.beginPath();
      c.arc(...at([0, 0]), Math.max(3, 0.2 * scale), 0, 2 * Math.PI);
      c.fillStyle = ink.card;
      c.fill();
    }

    #arm({ c, at, line, scale, ink }, flight, i, factor) {
      const [l1, l2] = this.manoeuvre.links;
      const colour = drm.line(flight.colour);
      const [angle, outside] = [flight.angle[i], flight.extension[i]];
      const [alpha, beta] = [flight.alpha[i] * factor, flight.beta[i] * factor];
      // by which the end slope of link 1 turns link 2
      const turn = flight.tip[i] * factor - 2 * (alpha + beta);
      const [sin, cos] = [Math.sin(angle), Math.cos(angle)];
      const place = (x, y) => [x * cos - y * sin, x * sin + y * cos];
      const y1 = (x) => alpha * phi(x / l1);
      const y2 = (x) => (outside > 0 ? 2 * alpha + (turn * (x - l1)) / outside + beta * phi((x - l1) / outside) : 2 * alpha);
      const sweep = (from, to, y) => Array.from({ length: PIECES + 1 }, (_, k) => {
        const x = from + ((to - from) * k) / PIECES;
        return place(x, y(x));
      });
      const tipAngle = angle + (outside > 0 ? Math.atan((3 * beta + turn) / outside) : 0);
      const thick = Math.max(7, 0.42 * scale);
      const thin = Math.max(4, 0.25 * scale);
      // where the tip has been in the last two seconds
      const steps = Math.round((2 * (this.count - 1)) / this.manoeuvre.duration);
      const path = [];
      for (let k = Math.max(0, i - steps); k <= i; k++) {
        const [s, o] = [Math.sin(flight.angle[k]), Math.cos(flight.angle[k])];
        const [r, y] = [l1 + flight.extension[k], flight.tip[k] * factor];
        path.push([r * o - y * s, r * s + y * o]);
      }
      const alphaBefore = c.globalAlpha;
      c.globalAlpha = 0.45 * alphaBefore;
      line(path, 2, colour);
      c.globalAlpha = alphaBefore;
      // link 2 slides out of link 1
      const link1 = sweep(0, l1, y1);
      const link2 = sweep(l1, l1 + outside, y2);
      line(link2, thin + 2, ink.edge);
      line(link2, thin, ink.tube);
      line(link2, Math.max(2, thin * 0.5), colour, flight.dash);
      line(link1, thick + 2, ink.edge);
      line(link1, thick, ink.tube);
      line(sweep(Math.max(0, l1 - (l2 - outside)), l1, y1), Math.max(1.6, thin * 0.34), colour, [3, 4]);
      // the payload: its area is its mass; dashed as it is reported
      const [x, y] = at(place(l1 + outside, 2 * (alpha + beta) + turn));
      const [mass, reported] = this.manoeuvre.masses.map((kg) => Math.max(4, 0.75 * scale * Math.sqrt(Math.max(0, kg) / 500)));
      const centre = [x + mass * Math.cos(tipAngle), y - mass * Math.sin(tipAngle)];
      c.beginPath();
      c.arc(...centre, mass, 0, 2 * Math.PI);
      c.fillStyle = colour;
      c.fill();
      c.lineWidth = 1.2;
      c.strokeStyle = ink.edge;
      c.stroke();
      if (Math.abs(reported - mass) > 0.4) {
        c.beginPath();
        c.arc(...centre, reported, 0, 2 * Math.PI);
        c.setLineDash([3, 3]);
        c.strokeStyle = ink.ink;
        c.stroke();
        c.setLineDash([]);
      }
    }
  }

  /** Two fingers zoom a chart; one finger goes to an instant. */
  const touched = (chart, report) => {
    const fingers = new Map();
    let start = null;
    const over = chart.over;
    const place = (event) => event.clientX - over.getBoundingClientRect().left;
    over.addEventListener("pointerdown", (event) => {
      if (event.pointerType !== "touch") return;
      fingers.set(event.pointerId, place(event));
      if (fingers.size === 2) {
        const [a, b] = [...fingers.values()];
        start = { a: chart.posToVal(Math.min(a, b), "x"), b: chart.posToVal(Math.max(a, b), "x") };
      }
    });
    over.addEventListener("pointermove", (event) => {
      if (!fingers.has(event.pointerId)) return;
      fingers.set(event.pointerId, place(event));
      if (fingers.size === 2 && start) {
        const [a, b] = [...fingers.values()].sort((p, q) => p - q);
        const width = over.clientWidth;
        const perPixel = (start.b - start.a) / Math.max(20, b - a);
        report.zoom(start.a - a * perPixel, start.a + (width - a) * perPixel);
      } else if (fingers.size === 1) {
        report.seek(chart.posToVal(place(event), "x"));
      }
    });
    for (const name of ["pointerup", "pointercancel"]) {
      over.addEventListener(name, (event) => { fingers.delete(event.pointerId); start = null; });
    }
  };

  class Report {
    constructor(place, content, number) {
      this.content = content;
      this.key = `flights-${number}`;
      this.hidden = new Set();
      this.time = 0;
      this.speed = 1;
      this.playing = false;
      this.beside = null; // what suits, until somebody chooses
      this.charts = [];
      this.#furnish(place);
      this.choose(0);
      drm.onTheme(() => this.rebuild());
      new ResizeObserver(() => this.resize()).observe(place);
    }

    #furnish(place) {
      const button = (text, act, properties = {}) => {
        const made = element("button", { type: "button", textContent: text, ...properties });
        made.addEventListener("click", act);
        return made;
      };
      this.play = button("▶", () => this.toggle(), { className: "primary", ariaLabel: "play", dataset: { act: "play" } });
      this.slider = element("input", { type: "range", min: 0, step: "any", ariaLabel: "time" });
      this.slider.addEventListener("input", () => this.seek(Number(this.slider.value)));
      this.clock = element("output", { textContent: "0.00 s" });
      const speeds = element("select", { ariaLabel: "speed" }, ...[0.25, 0.5, 1, 2, 4].map((value) => element("option", { value, textContent: `× ${value}`, selected: value === 1 })));
      speeds.addEventListener("change", () => { this.speed = Number(speeds.value); });
      this.who = element("div", { className: "who", role: "group", ariaLabel: "who is shown" });
      this.stage = element("div", { className: "stage" });
      this.factors = element("select", { ariaLabel: "factor of deflections" });
      this.factors.addEventListener("change", () => this.draw());
      const set = (entries) => element("span", { className: "set" }, ...entries);
      this.layouts = [["overlaid", false], ["side by side", true]].map(([text, beside]) => button(text, () => { this.beside = beside; this.arrange(); }, { dataset: { beside } }));
      this.ranges = [
        button("whole flight", () => this.zoom(0, this.manoeuvre.duration), { dataset: { range: "whole" } }),
        button("slew", () => this.zoom(0, this.manoeuvre.slewEnd), { dataset: { range: "slew" } }),
        button("after the slew", () => this.zoom(this.manoeuvre.slewEnd, this.manoeuvre.duration), { dataset: { range: "after" } }),
        button("−", () => this.scale(2), { ariaLabel: "zoom out" }),
        button("+", () => this.scale(0.5), { ariaLabel: "zoom in" }),
      ];
      this.scales = [["linear", false], ["logarithmic away from 0", true]].map(([text, logarithmic]) => button(text, () => { this.logarithmic = logarithmic; this.rebuild(); }, { dataset: { scale: logarithmic ? "log" : "linear" } }));
      this.shown = element("span", { className: "range" });
      this.grid = element("div", { className: "charts" });
      this.moreGrid = element("div", { className: "charts" });
      this.more = element("details", { className: "more" }, element("summary", { textContent: "More signals: momentum of the wheels, slew motor, extension" }), this.moreGrid);
      this.more.addEventListener("toggle", () => this.resize());
      const parts = [];
      if (this.content.manoeuvres.length > 1) {
        const choice = element("select", { ariaLabel: "episode", dataset: { act: "episode" } }, ...this.content.manoeuvres.map(({ title }, k) => element("option", { value: k, textContent: title })));
        choice.addEventListener("change", () => this.choose(Number(choice.value)));
        parts.push(element("div", { className: "tools" }, element("label", {}, "Episode", choice)));
      }
      this.caption = element("p", { className: "note" });
      place.append(
        ...parts,
        this.who,
        element("div", { className: "transport" }, this.play, this.slider, this.clock, element("label", {}, speeds)),
        this.stage,
        element("div", { className: "tools" }, set(this.layouts), element("label", {}, "deflections drawn", this.factors), this.caption),
        element("div", { className: "tools" }, "time shown:", set(this.ranges), this.shown), element("div", { className: "tools" }, "errors and deflection:", set(this.scales)),
        this.grid,
        ...(this.content.charts.some(({ more }) => more) ? [this.more] : []),
      );
      for (const child of [...place.children].slice(1)) child.style.marginTop = "10px";
      place.tabIndex = 0;
      place.addEventListener("keydown", (event) => {
        if (event.target.matches("input, select, button, summary")) return;
        const step = event.shiftKey ? 1 : 0.05;
        const acts = {
          " ": () => this.toggle(),
          ArrowRight: () => this.seek(this.time + step),
          ArrowLeft: () => this.seek(this.time - step),
          Home: () => this.seek(0),
          End: () => this.seek(this.manoeuvre.duration),
        };
        if (acts[event.key]) { event.preventDefault(); acts[event.key](); }
      });
    }

    /** Shows another manoeuvre. */
    choose(index) {
      this.manoeuvre = this.content.manoeuvres[index];
      this.arms = new Arms(this.manoeuvre);
      const { duration, intervals, magnification } = this.manoeuvre;
      this.times = Float64Array.from({ length: 2 * intervals + 1 }, (_, k) => (k * duration) / (2 * intervals));
      this.slider.max = duration;
      this.time = Math.min(this.time, duration);
      this.range = [0, duration];
      const factors = [...new Set([...FACTORS, magnification])].sort((a, b) => a - b);
      this.factors.replaceChildren(...factors.map((value) => element("option", { value, textContent: `× ${value}`, selected: value === magnification })));
      this.who.replaceChildren(...this.manoeuvre.flights.map((flight) => {
        const chip = element("button", { type: "button", className: "chip", ariaPressed: String(!this.hidden.has(flight.label)), dataset: { policy: flight.label } },
          mark(flight.colour, flight.dash), flight.diverged ? `${flight.label} (diverged at ${flight.end.toFixed(2)} s)` : flight.label);
        chip.addEventListener("click", () => {
          this.hidden[this.hidden.has(flight.label) ? "delete" : "add"](flight.label);
          chip.ariaPressed = String(!this.hidden.has(flight.label));
          this.charts.forEach(({ chart, series }) => series.forEach((label, k) => label === flight.label && chart.setSeries(k, { show: !this.hidden.has(label) })));
          this.arrange();
          this.tell();
        });
        return chip;
      }));
      this.signals = new Map(this.content.charts.map(({ key }) => [key, this.manoeuvre.flights.map(({ charts }) => Array.from(drm.numbers(charts[key]), (value) => (Number.isFinite(value) ? value : null)))]));
      // where one policy's error is far larger than another's, a linear scale shows the one alone
      const peaks = (this.signals.get("tip_error") ?? []).map((values) => values.reduce((most, value) => Math.max(most, Math.abs(value ?? 0)), 0)).filter((peak) => peak > 0);
      this.logarithmic ??= peaks.length > 1 && Math.max(...peaks) > 12 * Math.min(...peaks);
      this.rebuild();
      this.seek(this.time);
    }

    /** Whether a chart's scale is logarithmic away from zero. */
    bent(key) {
      return key in BENT && this.logarithmic;
    }

    visible() {
      return this.arms.flights.filter(({ label }) => !this.hidden.has(label));
    }

    /** Puts the pictures of the arm where they belong. */
    arrange() {
      const flights = this.visible();
      const width = this.stage.clientWidth || 800;
      const beside = (this.beside ?? (flights.length > 1 && flights.length < 5 && width / flights.length > 260)) && flights.length > 1;
      this.layouts.forEach((choice) => { choice.ariaPressed = String(choice.dataset.beside === String(beside)); });
      const panels = beside ? flights.map((flight) => [flight]) : [flights];
      const columns = beside ? Math.min(panels.length, Math.max(1, Math.floor(width / 250))) : 1;
      const across = (width - 8 * (columns - 1)) / columns;
      const height = Math.round(Math.max(210, Math.min(460, across * this.arms.shape + 74, 0.62 * window.innerHeight)));
      this.stage.style.gridTemplateColumns = `repeat(${columns}, minmax(0, 1fr))`;
      this.panels = panels.map((members) => {
        const canvas = element("canvas", { role: "img", ariaLabel: `the arm: ${members.map(({ label }) => label).join(", ")}` });
        const caption = element("figcaption");
        const figure = element("figure", {}, canvas, caption);
        figure.style.height = `${height}px`;
        return { members, canvas, caption, figure };
      });
      this.stage.replaceChildren(...this.panels.map(({ figure }) => figure));
      this.draw();
    }

    draw() {
      const wanted = Number(this.factors.value);
      const factor = this.arms.factor(wanted);
      const [mass, reported] = this.manoeuvre.masses;
      const told = reported === mass ? `${shown(mass)} kg` : `${shown(mass)} kg, reported as ${shown(reported)} kg (dashed ring)`;
      const drawn = factor < wanted ? `× ${shown(factor)}: × ${wanted} would bend the arm too far` : `× ${wanted}`;
      this.caption.textContent = `Deflections alone are drawn larger, ${drawn}. Dotted arm: where it should be. Dashed line: the target. Disc: payload of ${told}.`;
      for (const { members, canvas, caption } of this.panels) {
        this.arms.draw(canvas, members, this.time, wanted);
        const [only] = members;
        caption.replaceChildren();
        if (members.length === 1) {
          const error = this.content.charts.some(({ key }) => key === "tip_error") ? this.value("tip_error", only.label, this.time) : null;
          caption.append(mark(only.colour, only.dash), only.label);
          const gone = only.diverged && this.time > only.end;
          caption.append(element("small", { textContent: gone ? `diverged at ${only.end.toFixed(2)} s` : error === null ? "" : `tip error ${shown(error)} mm` }));
        }
      }
    }

    value(key, label, time) {
      const values = this.signals.get(key)[this.manoeuvre.flights.findIndex((flight) => flight.label === label)];
      return values[Math.min(values.length - 1, Math.max(0, Math.round((time / this.manoeuvre.duration) * (values.length - 1))))];
    }

    /** Makes the charts anew: for another manoeuvre or in other colours. */
    rebuild() {
      for (const { chart } of this.charts) chart.destroy();
      this.grid.replaceChildren();
      this.moreGrid.replaceChildren();
      this.charts = [];
      this.scales.forEach((choice) => { choice.ariaPressed = String((choice.dataset.scale === "log") === this.logarithmic); });
      this.arrange();
      for (const entry of this.content.charts) this.charts.push(this.#chart(entry));
      this.applyRange();
      this.tell();
    }

    #chart({ key, title, unit, meaning, more }) {
      const now = element("div", { className: "now" });
      const plot = element("div", { className: "plot", dataset: { signal: key } });
      const heading = element("h3", { title: meaning }, `${title} `, element("small", { textContent: `(${unit})` }));
      (more ? this.moreGrid : this.grid).append(element("article", { className: "chart" }, heading, now, plot));
      const data = [this.times];
      const series = [{}];
      const labels = [null];
      const extra = (values, options) => { data.push(values); series.push(options); labels.push(null); };
      const limit = this.manoeuvre.limits[key];
      if (key === "slew_angle") {
        const reference = drm.numbers(this.manoeuvre.reference);
        const degrees = Array.from(this.times, (_, k) => {
          const [a, b] = [reference[Math.floor(k / 2)], reference[Math.ceil(k / 2)]];
          return ((a + b) / 2) * (180 / Math.PI);
        });
        extra(degrees, { label: "reference", stroke: drm.colour("ring"), width: 7, points: { show: false } });
      }
      // what moves most goes behind what is calm
      const roughness = new Map(this.manoeuvre.flights.map((flight, k) => {
        const values = this.signals.get(key)[k];
        return [flight, values.reduce((sum, value, i) => sum + (i && value !== null && values[i - 1] !== null ? Math.abs(value - values[i - 1]) : 0), 0)];
      }));
      for (const flight of [...this.manoeuvre.flights].sort((a, b) => roughness.get(b) - roughness.get(a))) {
        data.push(this.signals.get(key)[this.manoeuvre.flights.indexOf(flight)]);
        series.push({ label: flight.label, stroke: drm.line(flight.colour), width: 1.3, alpha: 0.85, dash: flight.dash.map((length) => length * 1.2), show: !this.hidden.has(flight.label), points: { show: false } });
        labels.push(flight.label);
      }
      const instant = element("div", { className: "instant" });
      const slewing = element("div", { className: "slewing" });
      const item = { key, now, plot, instant, slewing, series: labels };
      const limits = (chart) => {
        if (!limit) return;
        const c = chart.ctx;
        c.save();
        c.beginPath();
        c.rect(chart.bbox.left, chart.bbox.top, chart.bbox.width, chart.bbox.height);
        c.clip();
        c.strokeStyle = drm.colour("soft");
        c.lineWidth = devicePixelRatio;
        c.setLineDash([3 * devicePixelRatio, 4 * devicePixelRatio]);
        for (const level of [limit, -limit]) {
          const y = chart.valToPos(level, "y", true);
          c.beginPath();
          c.moveTo(chart.bbox.left, y);
          c.lineTo(chart.bbox.left + chart.bbox.width, y);
          c.stroke();
        }
        c.restore();
      };
      let press = null;
      item.chart = new uPlot({
        width: Math.max(200, plot.clientWidth),
        height: 190,
        scales: { x: { time: false }, y: { ...(this.bent(key) ? { distr: 4, asinh: BENT[key] } : {}), range: (_, low, high) => (low === null ? [-1, 1] : this.bent(key) ? bentRange(low, high, BENT[key]) : low === high ? [low - 1e-3 - 0.1 * Math.abs(low), high + 1e-3 + 0.1 * Math.abs(high)] : uPlot.rangeNum(low, high, 0.06, true)) } },
        axes: (([x, y]) => [{ ...x, values: (_, ticks) => ticks.map((tick) => `${+tick.toFixed(3)}${tick === ticks.at(-1) ? " s" : ""}`) }, { ...y, ...(this.bent(key) ? { splits: (chart, index, low, high) => bentTicks(low, high, BENT[key]) ?? [low, (low + high) / 2, high] } : {}), values: (_, ticks) => ticks.map((tick) => (tick === null ? "" : String(+tick.toPrecision(6)).replace("-", "−"))) }])(drm.axes(unit)),
        legend: { show: false },
        cursor: {
          y: false,
          drag: { x: true, y: false, dist: 6 },
          points: { size: 6 },
          sync: { key: this.key, setSeries: false, filters: { pub: (type) => type !== "mousedown" && type !== "mouseup" } },
        },
        series,
        hooks: {
          draw: [limits],
          setScale: [(chart, scale) => {
            if (scale === "x" && !this.linking) this.zoom(chart.scales.x.min, chart.scales.x.max);
            else this.place(item);
          }],
          setSize: [() => this.place(item)],
          setCursor: [(chart) => { this.hover = chart.cursor.idx ?? null; this.later(); }],
        },
      }, data, plot);
      item.chart.over.append(slewing, instant);
      item.chart.over.addEventListener("mousedown", (event) => { press = event.clientX; });
      item.chart.over.addEventListener("mouseup", (event) => {
        if (press !== null && Math.abs(event.clientX - press) < 4) this.seek(item.chart.posToVal(event.clientX - item.chart.over.getBoundingClientRect().left, "x"));
        press = null;
      });
      touched(item.chart, this);
      return item;
    }

    /** The range of time that all charts show. */
    zoom(from, to) {
      const { duration, intervals } = this.manoeuvre;
      const least = Math.min(duration, (4 * duration) / intervals);
      let [low, high] = [Math.max(0, Math.min(from, to)), Math.min(duration, Math.max(from, to))];
      if (high - low < least) {
        const middle = Math.min(duration - least / 2, Math.max(least / 2, (low + high) / 2));
        [low, high] = [middle - least / 2, middle + least / 2];
      }
      this.range = [low, high];
      this.applyRange();
    }

    scale(factor) {
      const [low, high] = this.range;
      const inside = this.time >= low && this.time <= high ? this.time : (low + high) / 2;
      this.zoom(inside - (inside - low) * factor, inside + (high - inside) * factor);
    }

    applyRange() {
      const [low, high] = this.range;
      this.linking = true;
      for (const { chart } of this.charts) {
        if (chart.scales.x.min !== low || chart.scales.x.max !== high) chart.setScale("x", { min: low, max: high });
      }
      // scales are set in a microtask
      queueMicrotask(() => queueMicrotask(() => {
        this.linking = false;
        this.charts.forEach((item) => this.place(item));
      }));
      const { duration, slewEnd } = this.manoeuvre;
      const near = (a, b) => Math.abs(a - b) < 1e-6;
      const named = { whole: [0, duration], slew: [0, slewEnd], after: [slewEnd, duration] };
      this.ranges.forEach((choice) => {
        const range = named[choice.dataset.range];
        if (range) choice.ariaPressed = String(near(low, range[0]) && near(high, range[1]));
      });
      this.shown.textContent = `${low.toFixed(2)} to ${high.toFixed(2)} s`;
    }

    /** Where the instant and the time of the slew are in a chart. */
    place({ chart, instant, slewing }) {
      if (!chart) return;
      const width = chart.over.clientWidth;
      const x = chart.valToPos(this.time, "x");
      instant.hidden = !(x >= 0 && x <= width);
      instant.style.transform = `translateX(${x}px)`;
      const end = Math.min(width, Math.max(0, chart.valToPos(this.manoeuvre.slewEnd, "x")));
      slewing.style.width = `${end}px`;
    }

    /** Says the values at the cursor, else at the instant; once a picture. */
    later() {
      if (this.waiting) return;
      this.waiting = true;
      requestAnimationFrame(() => { this.waiting = false; this.tell(); });
    }

    tell() {
      const time = this.hover === null || this.hover === undefined ? this.time : this.times[this.hover];
      const flights = this.manoeuvre.flights.filter(({ label }) => !this.hidden.has(label));
      for (const { key, now } of this.charts) {
        now.replaceChildren(`${time.toFixed(2)} s`, ...flights.map((flight) => element("span", { title: flight.label }, mark(flight.colour, flight.dash), shown(this.value(key, flight.label, time)))));
      }
    }

    seek(time) {
      this.time = Math.min(this.manoeuvre.duration, Math.max(0, time));
      this.slider.value = this.time;
      this.slider.setAttribute("aria-valuetext", `${this.time.toFixed(2)} s`);
      this.clock.textContent = `${this.time.toFixed(2)} s`;
      this.draw();
      this.charts.forEach((item) => this.place(item));
      this.later();
    }

    toggle() {
      this.playing = !this.playing;
      this.play.textContent = this.playing ? "❚❚" : "▶";
      this.play.ariaLabel = this.playing ? "pause" : "play";
      if (!this.playing) return;
      if (this.time >= this.manoeuvre.duration - 1e-9) this.seek(0);
      let before = performance.now();
      const step = (moment) => {
        if (!this.playing) return;
        const next = this.time + (Math.max(0, moment - before) / 1e3) * this.speed;
        before = moment;
        this.seek(next);
        if (next >= this.manoeuvre.duration) this.toggle();
        else requestAnimationFrame(step);
      };
      requestAnimationFrame(step);
    }

    resize() {
      const width = this.stage.clientWidth;
      if (width !== this.width) {
        this.width = width;
        this.arrange();
      }
      for (const { chart, plot } of this.charts) {
        if (plot.clientWidth && plot.clientWidth !== chart.width) chart.setSize({ width: plot.clientWidth, height: 190 });
      }
    }
  }

  drm.flights = drm.parts("flights").map(([place, content], number) => new Report(place, content, number));
  document.documentElement.dataset.state = "drawn";
})();
