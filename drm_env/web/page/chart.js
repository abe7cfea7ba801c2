// Strip charts and the spectrum: lines on a canvas, drawn anew when flights change, and a cursor above them.

const MARGIN = { left: 46, right: 10, top: 6, bottom: 20 };

/** Steps of 1, 2 or 5 times a power of ten, about `count` of them in a range. */
function stepOf(range, count) {
  const rough = range / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
}

const tick = (value, step) => {
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return value.toFixed(Math.min(decimals, 6)).replace("-", "−");
};

class Plot {
  constructor(parent, title, unit) {
    const box = document.createElement("article");
    box.className = "chart";
    box.innerHTML = `<header><h3></h3><div class="now"></div></header><div class="plot"><canvas role="img"></canvas><div class="cursor" hidden></div></div>`;
    parent.append(box);
    const heading = box.querySelector("h3");
    heading.textContent = `${title} `;
    const small = document.createElement("small");
    small.textContent = unit;
    heading.append(small);
    this.now = box.querySelector(".now");
    this.plot = box.querySelector(".plot");
    this.canvas = box.querySelector("canvas");
    this.canvas.setAttribute("aria-label", `${title}, ${unit}`);
    this.cursor = box.querySelector(".cursor");
    this.context = this.canvas.getContext("2d");
  }

  /** Clears the canvas and draws the frame; returns the places of values. */
  frame({ x0, x1, y0, y1, ink, yTicks, xTicks, xPlace, yPlace }) {
    const c = this.context;
    const { clientWidth: width, clientHeight: height } = this.plot;
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    const [left, right, top, bottom] = [MARGIN.left, width - MARGIN.right, MARGIN.top, height - MARGIN.bottom];
    const [sx, sy] = [xPlace ?? ((v) => v), yPlace ?? ((v) => v)];
    const x = (value) => left + ((right - left) * (sx(value) - sx(x0))) / (sx(x1) - sx(x0));
    const y = (value) => bottom - ((bottom - top) * (sy(value) - sy(y0))) / (sy(y1) - sy(y0));
    c.font = "11px system-ui, sans-serif";
    c.lineWidth = 1;
    c.fillStyle = ink.soft;
    c.strokeStyle = ink.grid;
    c.textBaseline = "middle";
    c.textAlign = "right";
    for (const [value, text] of yTicks) {
      c.beginPath();
      c.moveTo(left, y(value));
      c.lineTo(right, y(value));
      c.stroke();
      c.fillText(text, left - 6, y(value));
    }
    c.textAlign = "center";
    c.textBaseline = "top";
    for (const [value, text] of xTicks) {
      c.beginPath();
      c.moveTo(x(value), top);
      c.lineTo(x(value), bottom);
      c.stroke();
      c.fillText(text, Math.min(x(value), right - 8), bottom + 5);
    }
    Object.assign(this, { left, right, top, bottom, x, y, x0, x1 });
    this.cursor.style.height = `${bottom - top}px`;
    c.save();
    c.beginPath();
    c.rect(left, top, right - left, bottom - top);
    c.clip();
    return { c, x, y };
  }

  values(entries) {
    while (this.now.children.length > entries.length) this.now.lastChild.remove();
    entries.forEach(({ colour, text }, k) => {
      let entry = this.now.children[k];
      if (!entry) {
        entry = document.createElement("span");
        entry.innerHTML = `<i class="dot"></i><b></b>`;
        this.now.append(entry);
      }
      entry.firstChild.style.setProperty("--of", colour);
      if (entry.lastChild.textContent !== text) entry.lastChild.textContent = text;
    });
  }
}

function stroke(c, { colour, dash, width = 1.7 }) {
  c.strokeStyle = colour;
  c.lineWidth = width;
  c.lineJoin = "round";
  c.setLineDash(dash ?? []);
  c.stroke();
  c.setLineDash([]);
}

/** A signal over time. `signal(flight, i)` is its value in the chart's unit; `limits(flight)` are drawn dashed. */
export class Strip extends Plot {
  constructor(parent, { title, unit, digits = 1, signal, reference, limits }, seek) {
    super(parent, title, unit);
    Object.assign(this, { signal, reference, limits, digits });
    const to = (event) => {
      const { left } = this.plot.getBoundingClientRect();
      const part = (event.clientX - left - this.left) / (this.right - this.left);
      seek(this.x0 + Math.min(1, Math.max(0, part)) * (this.x1 - this.x0));
    };
    this.plot.addEventListener("pointerdown", (event) => {
      this.plot.setPointerCapture(event.pointerId);
      to(event);
    });
    this.plot.addEventListener("pointermove", (event) => {
      if (event.buttons) to(event);
    });
  }

  draw(racers, duration, ink) {
    let [low, high] = [Infinity, -Infinity];
    const see = (value) => {
      if (Number.isFinite(value)) [low, high] = [Math.min(low, value), Math.max(high, value)];
    };
    for (const { flight } of racers) {
      for (let i = 0; i < flight.samples; i++) see(this.signal(flight, i));
    }
    if (this.reference) for (let i = 0; i < racers[0].flight.samples; i += 10) see(this.reference(racers[0].flight, i));
    if (!(high > low)) [low, high] = [(Number.isFinite(low) ? low : 0) - 1, (Number.isFinite(high) ? high : 0) + 1];
    const pad = 0.07 * (high - low);
    [low, high] = [low - pad, high + pad];
    const ySteps = stepOf(high - low, 4);
    const xSteps = stepOf(duration, 6);
    const ticks = (from, to, step) => {
      const found = [];
      for (let k = Math.ceil(from / step); k * step <= to + 1e-9; k++) found.push([k * step, tick(k * step, step)]);
      return found;
    };
    const xTicks = ticks(0, duration, xSteps);
    xTicks.at(-1)[1] += " s";
    const { c, x, y } = this.frame({ x0: 0, x1: duration, y0: low, y1: high, ink, yTicks: ticks(low, high, ySteps), xTicks });
    const end = racers[0].flight.metrics.slew_end_time;
    c.fillStyle = ink.slew;
    c.fillRect(x(0), this.top, x(Math.min(end, duration)) - x(0), this.bottom - this.top);
    c.beginPath();
    c.moveTo(x(0), y(0));
    c.lineTo(x(duration), y(0));
    stroke(c, { colour: ink.line, width: 1 });
    for (const limit of this.limits?.(racers[0].flight) ?? []) {
      c.beginPath();
      c.moveTo(x(0), y(limit));
      c.lineTo(x(duration), y(limit));
      stroke(c, { colour: ink.soft, width: 1, dash: [3, 4] });
    }
    const line = (flight, of, step) => {
      c.beginPath();
      const time = flight.signals.time;
      for (let i = 0; i < flight.samples; i += step) c.lineTo(x(time[i]), y(of(flight, i)));
    };
    if (this.reference) {
      line(racers[0].flight, this.reference, 5);
      stroke(c, { colour: ink.ink, width: 1.3, dash: [5, 4] });
    }
    for (const { flight, colour, dash } of [...racers].reverse()) {
      line(flight, this.signal, 1);
      stroke(c, { colour, dash });
    }
    c.restore();
    this.cursor.hidden = false;
  }

  seek(racers, time, i) {
    this.cursor.style.transform = `translateX(${this.x(time)}px)`;
    this.values(racers.map(({ flight, colour }) => {
      const value = this.signal(flight, Math.min(i, flight.samples - 1));
      return { colour, text: value.toFixed(this.digits).replace("-", "−") };
    }));
  }
}

/** Amplitudes over frequency, both logarithmic. */
export class Spectrum extends Plot {
  constructor(parent, title, unit) {
    super(parent, title, unit);
    this.plot.style.cursor = "default";
  }

  /** `lines` are {frequency, amplitude, colour, dash}; `marks` are natural frequencies, Hz. */
  draw(lines, marks, ink, range = { x0: 0.2, x1: 50, y0: 1e-4, y1: 1e2 }) {
    const decades = (from, to) => {
      const found = [];
      for (let k = Math.ceil(Math.log10(from) - 1e-9); 10 ** k <= to * 1.0001; k++) {
        found.push([10 ** k, k >= 0 ? String(10 ** k) : (10 ** k).toFixed(-k)]);
      }
      return found;
    };
    const yTicks = decades(range.y0, range.y1).filter((_, k, { length }) => length < 6 || k % 2 === 0);
    const xTicks = decades(range.x0, range.x1);
    xTicks.push([range.x1, `${range.x1} Hz`]);
    const { c, x, y } = this.frame({ ...range, ink, yTicks, xTicks, xPlace: Math.log10, yPlace: (v) => Math.log10(Math.max(v, 1e-12)) });
    c.textBaseline = "top";
    c.textAlign = "left";
    c.fillStyle = ink.soft;
    marks.forEach((mark, k) => {
      c.beginPath();
      c.moveTo(x(mark), this.top);
      c.lineTo(x(mark), this.bottom);
      stroke(c, { colour: ink.soft, width: 1, dash: [4, 4] });
      const text = `${mark.toFixed(2)} Hz`;
      const beside = x(mark) + 4 + c.measureText(text).width < this.right ? 4 : -4;
      c.textAlign = beside > 0 ? "left" : "right";
      c.fillText(text, x(mark) + beside, this.top + 2 + 13 * (k % 2));
    });
    for (const { frequency, amplitude, colour, dash } of [...lines].reverse()) {
      c.beginPath();
      for (let i = 1; i < frequency.length; i++) {
        if (frequency[i] >= range.x0 / 1.2) c.lineTo(x(frequency[i]), y(amplitude[i]));
      }
      stroke(c, { colour, dash });
    }
    c.restore();
  }
}
