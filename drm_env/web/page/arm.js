// The picture of the arms: where everything is, in metres, and how it is drawn.

const TRAIL = 250; // samples of the tip's path that are shown
const SWEEP = 40; // pieces of a bent link

const phi = (u) => (3 - u) * u * u;

/** The arm of a flight at sample i in metres, its deflections drawn `factor` times as large. */
function shapeOf({ signals, scenario, payload }, i, factor) {
  const angle = signals.slew_angle[i];
  const alpha = signals.alpha[i] * factor;
  const beta = signals.beta[i] * factor;
  const outside = signals.extension[i];
  const [l1, l2] = [scenario.arm.link1.length, scenario.arm.link2.length];
  // by which the end slope of link 1 turns link 2
  const turn = signals.tip_deflection[i] * factor - 2 * (alpha + beta);
  const [sin, cos] = [Math.sin(angle), Math.cos(angle)];
  const place = (x, y) => [x * cos - y * sin, x * sin + y * cos];
  const y1 = (x) => alpha * phi(x / l1);
  const y2 = (x) => 2 * alpha + (turn * (x - l1)) / outside + beta * phi((x - l1) / outside);
  const sweep = (from, to, y) => Array.from({ length: SWEEP + 1 }, (_, k) => {
    const x = from + ((to - from) * k) / SWEEP;
    return place(x, y(x));
  });
  const slope = Math.atan((3 * beta + turn) / outside);
  return {
    angle,
    link1: sweep(0, l1, y1),
    inner: sweep(Math.max(0, l1 - (l2 - outside)), l1, y1),
    link2: sweep(l1, l1 + outside, y2),
    tip: place(l1 + outside, 2 * (alpha + beta) + turn),
    tipAngle: angle + slope,
    payload,
  };
}

/** Draws flights on a canvas that fills its element. */
export class Stage {
  #canvas;
  #context;
  #view = null;
  #trails = new Map();

  constructor(canvas) {
    this.#canvas = canvas;
    this.#context = canvas.getContext("2d");
  }

  /** Fits the camera to everything that the flights reach; `left` pixels are taken by something else. */
  fit(flights, left) {
    const { clientWidth: width, clientHeight: height } = this.#canvas;
    this.#view = null;
    if (width < left + 100 || height < 80) return;
    const box = { x0: -1, x1: 1, y0: -1, y1: 1 };
    for (const { signals, scenario, samples, payload } of flights) {
      for (let i = 0; i < samples; i += 10) {
        const reach = scenario.arm.link1.length + signals.extension[i] + payload[0] + 0.6;
        for (const angle of [signals.slew_angle[i], signals.reference_angle[i]]) {
          const [x, y] = [reach * Math.cos(angle), reach * Math.sin(angle)];
          box.x0 = Math.min(box.x0, x);
          box.x1 = Math.max(box.x1, x);
          box.y0 = Math.min(box.y0, y);
          box.y1 = Math.max(box.y1, y);
        }
      }
    }
    const margin = 26;
    const across = width - left - 2 * margin;
    const scale = Math.min(across / (box.x1 - box.x0), (height - 2 * margin) / (box.y1 - box.y0));
    const ratio = window.devicePixelRatio || 1;
    this.#canvas.width = Math.round(width * ratio);
    this.#canvas.height = Math.round(height * ratio);
    this.#view = {
      width, height, left, ratio, scale, reach: Math.max(...flights.map(({ scenario }) => scenario.arm.link1.length + scenario.arm.link2.length), 15),
      x: left + margin + (across - scale * (box.x1 - box.x0)) * (left ? 0.38 : 0.5) - scale * box.x0,
      y: height / 2 + (scale * (box.y0 + box.y1)) / 2,
      largest: Math.max(...flights.map(({ signals }) => signals.tip_deflection.reduce((most, y) => Math.max(most, Math.abs(y)), 0))),
      error: Math.max(...flights.map(({ signals }) => signals.tip_error.reduce((most, y) => Math.max(most, Math.abs(y)), 0))),
    };
    this.#trails.clear();
  }

  /** The factor by which deflections can be drawn larger: at most a sixth of the arm. */
  factor(wanted) {
    const { largest, reach } = this.#view ?? { largest: 0, reach: 1 };
    const most = reach / 6 / largest;
    return most < wanted ? Math.max(1, Math.floor(most)) : wanted;
  }

  #at([x, y]) {
    const { scale } = this.#view;
    return [this.#view.x + scale * x, this.#view.y - scale * y];
  }

  #line(points, width, colour, dash = []) {
    const c = this.#context;
    c.beginPath();
    points.forEach((point, k) => c[k ? "lineTo" : "moveTo"](...this.#at(point)));
    c.lineWidth = width;
    c.strokeStyle = colour;
    c.setLineDash(dash);
    c.stroke();
    c.setLineDash([]);
  }

  /** `racers` are {flight, colour, dash}, the first in front; all at sample i. */
  draw(racers, i, wanted, ink) {
    if (!this.#view || !racers.length) return;
    const factor = this.factor(wanted);
    const c = this.#context;
    const { width, height, ratio } = this.#view;
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, width, height);
    c.lineJoin = "round";
    c.lineCap = "round";
    this.#backdrop(racers[0].flight, ink);
    this.#ghost(racers[0].flight, Math.min(i, racers[0].flight.samples - 1), ink);
    [...racers].reverse().forEach((racer, k, { length }) => {
      c.globalAlpha = k === length - 1 ? 1 : 0.62;
      this.#arm(racer, Math.min(i, racer.flight.samples - 1), factor, ink);
    });
    c.globalAlpha = 1;
    this.#hub(racers, i, ink);
    this.#target(racers, i, ink);
  }

  /** The tips beside the place where they should be, on a scale that shows a metre and a tenth of a millimetre. */
  #target(racers, i, ink) {
    const c = this.#context;
    const { width, height, left } = this.#view;
    const radius = Math.min(92, height * 0.21);
    // beside the sector that the arm sweeps
    const steep = Math.abs(racers[0].flight.scenario.slew.angle) > 1.3;
    const [x, y] = [steep ? width - radius - 20 : left + radius + 22, radius + 16];
    const most = Math.max(100, 1.2e3 * this.#view.error);
    const place = (mm) => (radius * Math.asinh(mm / 0.3)) / Math.asinh(most / 0.3);
    c.beginPath();
    c.arc(x, y, radius + 6, 0, 2 * Math.PI);
    c.fillStyle = ink.card;
    c.fill();
    c.strokeStyle = ink.line;
    c.lineWidth = 1;
    c.stroke();
    c.font = "10px system-ui, sans-serif";
    c.textAlign = "center";
    c.textBaseline = "middle";
    for (let mm = 1; mm <= most; mm *= 10) {
      c.beginPath();
      c.arc(x, y, place(mm), 0, 2 * Math.PI);
      c.strokeStyle = ink.ring;
      c.stroke();
    }
    const k = (flight) => Math.min(i, flight.samples - 1);
    const spot = ({ signals }, j) => {
      const [error, angle] = [1e3 * signals.tip_error[j], signals.reference_angle[j]];
      const r = Math.sign(error) * place(Math.abs(error));
      return [x - r * Math.sin(angle), y - r * Math.cos(angle)];
    };
    const angle = racers[0].flight.signals.reference_angle[k(racers[0].flight)];
    for (const turned of [angle, angle + Math.PI / 2]) {
      c.beginPath();
      c.moveTo(x - radius * Math.cos(turned), y + radius * Math.sin(turned));
      c.lineTo(x + radius * Math.cos(turned), y - radius * Math.sin(turned));
      c.setLineDash([3, 4]);
      c.strokeStyle = ink.soft;
      c.stroke();
      c.setLineDash([]);
    }
    // from outside, as far as there is room
    let free = Infinity;
    for (let mm = 10 ** Math.floor(Math.log10(most)); mm >= 1; mm /= 10) {
      const text = mm < 1000 ? `${mm}` : `${mm / 1000} m`;
      const half = c.measureText(text).width / 2 + 2;
      const at = x + place(mm);
      const down = y;
      if (at + half > free) continue;
      free = at - half - 3;
      c.fillStyle = ink.card;
      c.fillRect(at - half, down - 6, 2 * half, 12);
      c.fillStyle = ink.soft;
      c.fillText(text, at, down);
    }
    for (const { flight, colour } of [...racers].reverse()) {
      const j = k(flight);
      c.strokeStyle = colour;
      c.lineWidth = 2;
      for (let m = Math.max(0, j - TRAIL); m < j; m += 2) {
        c.globalAlpha = 0.7 * (1 - (j - m) / TRAIL);
        c.beginPath();
        c.moveTo(...spot(flight, m));
        c.lineTo(...spot(flight, Math.min(m + 2, j)));
        c.stroke();
      }
      c.globalAlpha = 1;
      c.beginPath();
      c.arc(...spot(flight, j), 5.5, 0, 2 * Math.PI);
      c.fillStyle = colour;
      c.fill();
      c.lineWidth = 1.5;
      c.strokeStyle = ink.card;
      c.stroke();
    }
    c.fillStyle = ink.soft;
    c.font = "11px system-ui, sans-serif";
    // centred, but whole on a narrow screen
    const label = "tip seen close; rings in mm";
    const from = c.measureText(label).width / 2 + 6;
    c.fillText(label, Math.max(x, from), y + radius + 19);
  }

  #backdrop({ scenario }, ink) {
    const c = this.#context;
    const { scale, reach } = this.#view;
    const [x, y] = this.#at([0, 0]);
    c.font = "11px system-ui, sans-serif";
    c.textBaseline = "alphabetic";
    c.fillStyle = ink.soft;
    for (let radius = 5; radius <= reach + 5; radius += 5) {
      c.beginPath();
      c.arc(x, y, radius * scale, 0, 2 * Math.PI);
      c.lineWidth = 1;
      c.strokeStyle = ink.ring;
      c.stroke();
    }
    for (let angle = -180; angle < 180; angle += 10) {
      const a = (angle * Math.PI) / 180;
      const ray = (r) => [r * Math.cos(a), r * Math.sin(a)];
      this.#line([ray(2), ray(reach + 12)], 1, angle % 30 ? ink.spoke : ink.ring);
    }
    const target = scenario.slew.angle;
    const along = (r, a) => [r * Math.cos(a), r * Math.sin(a)];
    this.#line([along(1.2, 0), along(reach + 12, 0)], 1, ink.soft, [2, 6]);
    this.#line([along(1.2, target), along(reach + 12, target)], 1.4, ink.soft, [7, 6]);
    const [tx, ty] = this.#at(along(Math.max(4.4, 58 / scale), target));
    c.save();
    c.translate(tx, ty);
    c.rotate(Math.abs(target) > Math.PI / 2 ? Math.PI - target : -target);
    c.textAlign = "left";
    c.fillText(`target ${((target * 180) / Math.PI).toFixed(0)}°`, 0, -6);
    c.restore();
  }

  #ghost({ signals, scenario, payload }, i, ink) {
    const angle = signals.reference_angle[i];
    const reach = scenario.arm.link1.length + signals.extension[i];
    const along = (r, side = 0) => [r * Math.cos(angle) - side * Math.sin(angle), r * Math.sin(angle) + side * Math.cos(angle)];
    this.#line([[0, 0], along(reach)], 1.5, ink.ink, [4, 5]);
    const half = payload[1] / 2;
    if (half > 0) {
      const corners = [along(reach, half), along(reach + payload[0], half), along(reach + payload[0], -half), along(reach, -half), along(reach, half)];
      this.#line(corners, 1.2, ink.ink, [3, 4]);
    }
  }

  #arm({ flight, colour, dash }, i, factor, ink) {
    const c = this.#context;
    const { scale } = this.#view;
    const shape = shapeOf(flight, i, factor);
    this.#trail(flight, i, factor, colour);
    const thick = Math.max(9, 0.42 * scale);
    const thin = Math.max(5, 0.25 * scale);
    // link 2 slides out of link 1
    this.#line(shape.link2, thin + 2, ink.edge);
    this.#line(shape.link2, thin, ink.tube2);
    this.#line(shape.link2, Math.max(2, thin * 0.34), colour, dash);
    this.#line(shape.link1, thick + 2, ink.edge);
    this.#line(shape.link1, thick, ink.tube1);
    this.#line(shape.inner, Math.max(1.6, thin * 0.3), colour, [3, 4]);
    const end = shape.link1.slice(-3);
    this.#line(end, thick + 3, ink.edge);
    this.#line(end, thick + 1, colour);
    const [x, y] = this.#at(shape.tip);
    c.save();
    c.translate(x, y);
    c.rotate(-shape.tipAngle);
    const [long, wide] = [shape.payload[0] * scale, shape.payload[1] * scale];
    if (wide > 0) {
      c.beginPath();
      c.roundRect(0, -wide / 2, long, wide, Math.min(4, wide / 4));
      c.fillStyle = colour;
      c.fill();
      c.lineWidth = 1.5;
      c.strokeStyle = ink.edge;
      c.stroke();
      c.beginPath();
      c.rect(long * 0.18, -wide * 0.32, long * 0.64, wide * 0.64);
      c.strokeStyle = "rgb(255 255 255 / 45%)";
      c.stroke();
    }
    c.restore();
    this.#wheel(x, y, Math.max(5, 0.3 * scale), flight.signals.tip_momentum[i] * 0.4, colour, ink);
  }

  #trail(flight, i, factor, colour) {
    const key = `${factor}`;
    let kept = this.#trails.get(flight);
    if (kept?.key !== key) {
      kept = { key, tips: Array.from({ length: flight.samples }, (_, k) => this.#tip(flight, k, factor)) };
      this.#trails.set(flight, kept);
    }
    const c = this.#context;
    const alpha = c.globalAlpha;
    for (let k = Math.max(0, i - TRAIL); k < i; k += 2) {
      c.globalAlpha = alpha * 0.75 * (1 - (i - k) / TRAIL);
      this.#line([kept.tips[k], kept.tips[Math.min(k + 2, i)]], 2, colour);
    }
    c.globalAlpha = alpha;
  }

  #tip({ signals, scenario }, i, factor) {
    const reach = scenario.arm.link1.length + signals.extension[i];
    const y = signals.tip_deflection[i] * factor;
    const [sin, cos] = [Math.sin(signals.slew_angle[i]), Math.cos(signals.slew_angle[i])];
    return [reach * cos - y * sin, reach * sin + y * cos];
  }

  #wheel(x, y, radius, turned, colour, ink) {
    const c = this.#context;
    c.beginPath();
    c.arc(x, y, radius, 0, 2 * Math.PI);
    c.fillStyle = ink.card;
    c.fill();
    c.lineWidth = Math.max(2, radius * 0.28);
    c.strokeStyle = colour;
    c.stroke();
    c.lineWidth = Math.max(1.2, radius * 0.14);
    for (let k = 0; k < 3; k++) {
      const a = -turned + (k * Math.PI) / 3;
      c.beginPath();
      c.moveTo(x - radius * Math.cos(a), y - radius * Math.sin(a));
      c.lineTo(x + radius * Math.cos(a), y + radius * Math.sin(a));
      c.stroke();
    }
  }

  #hub(racers, i, ink) {
    const c = this.#context;
    const [x, y] = this.#at([0, 0]);
    const radius = Math.max(13, 0.75 * this.#view.scale);
    c.beginPath();
    c.arc(x, y, radius + 5, 0, 2 * Math.PI);
    c.fillStyle = ink.edge;
    c.fill();
    const { flight, colour } = racers[0];
    const k = Math.min(i, flight.samples - 1);
    this.#wheel(x, y, radius, flight.signals.root_momentum[k] * 0.04 + flight.signals.slew_angle[k], colour, ink);
  }
}
