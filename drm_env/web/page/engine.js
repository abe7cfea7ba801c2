// The engine as the page sees it: promises of flights, flown in a worker each.

/** Every so many samples of 2 ms are kept: 100 a second. */
export const EVERY = 5;

/** The bytes in a base64 text, unpacked if they are packed with gzip. */
export async function bytesOf(text, packed = false) {
  const raw = Uint8Array.from(atob(text.trim()), (letter) => letter.charCodeAt(0));
  if (!packed) return raw;
  const stream = new Blob([raw]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Names to parts of a flight's numbers. */
function flightOf({ contents, numbers, milliseconds }) {
  const { metrics, signals, samples, lengths, frequencies } = contents;
  let at = 0;
  const take = (count) => numbers.subarray(at, (at += count));
  const flight = { milliseconds, scenario: contents.scenario, payload: contents.payload, samples, metrics: {}, signals: {} };
  metrics.forEach((name) => { [flight.metrics[name]] = take(1); });
  signals.forEach((name) => { flight.signals[name] = take(samples); });
  flight.lengths = take(lengths);
  flight.frequencies = Array.from({ length: lengths }, () => take(frequencies));
  const { extension, slew_angle: angle, reference_angle: reference, tip_deflection: tip } = flight.signals;
  const { length } = flight.scenario.arm.link1;
  // the tip's error r e + y, m
  flight.signals.tip_error = tip.map((y, i) => (length + extension[i]) * (angle[i] - reference[i]) + y);
  return flight;
}

/** A worker that flies. Of requests that come while it flies, the last one alone is flown. */
export class Pilot {
  #worker;
  #flying = null;
  #next = null;

  constructor(source, modules) {
    this.#worker = new Worker(URL.createObjectURL(new Blob([source], { type: "text/javascript" })));
    this.module = new Promise((resolve, reject) => {
      this.#worker.onmessage = ({ data }) => (data.module ? resolve(data.module) : this.#landed(data));
      this.#worker.onerror = (event) => reject(new Error(event.message));
    });
    this.#worker.postMessage(modules);
  }

  /** A promise of {flight} or {refused}; null if a later request has taken this one's place. */
  fly(request, weights) {
    return new Promise((resolve) => {
      this.#next?.resolve(null);
      this.#next = { request: JSON.stringify(request), weights, resolve };
      this.#start();
    });
  }

  #start() {
    if (this.#flying || !this.#next) return;
    this.#flying = this.#next;
    this.#next = null;
    const { request, weights } = this.#flying;
    this.#worker.postMessage({ id: 0, request, weights });
  }

  #landed(data) {
    const { resolve } = this.#flying;
    this.#flying = null;
    const late = this.#next !== null;
    this.#start();
    if (late) resolve(null);
    else resolve(data.refused ? { refused: data.refused } : { flight: flightOf(data) });
  }
}
