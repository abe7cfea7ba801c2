// Runs in a worker: flies what it is asked for, one request after the other.
// in:  {fast, portable}, the two modules' bytes, once; then {id, request, weights}
// out: {module}; then {id, milliseconds, contents, numbers} or {id, refused}
"use strict";

let engine = null;

async function start({ fast, portable }) {
  const make = async (bytes) => (await WebAssembly.instantiate(bytes, {})).instance.exports;
  // A browser without relaxed instructions refuses the fast module; where a processor does not fuse them, its
  // numbers would not be everybody's.
  let made = fast && WebAssembly.validate(fast) ? await make(fast) : null;
  const exact = made !== null && made.exact() === 1;
  if (!exact) made = await make(portable);
  engine = { ...made, name: exact ? "relaxed" : "portable", bytes: exact ? fast : portable, make };
  return engine.name;
}

function write(bytes) {
  const address = engine.allocate(bytes.length);
  new Uint8Array(engine.memory.buffer).set(bytes, address);
  return [address, bytes.length];
}

function fly(request, weights) {
  const text = write(new TextEncoder().encode(request));
  const given = write(weights ?? new Uint8Array(0));
  const begin = performance.now();
  const reply = engine.fly(...text, ...given);
  const milliseconds = performance.now() - begin;
  const [refused, at, bytes, first, count] = new Uint32Array(engine.memory.buffer, reply, 5);
  const said = new TextDecoder().decode(new Uint8Array(engine.memory.buffer, at, bytes));
  const numbers = new Float64Array(engine.memory.buffer, first, count).slice();
  engine.forget(reply);
  engine.release(...text);
  engine.release(...given);
  return refused ? { refused: said } : { milliseconds, contents: JSON.parse(said), numbers };
}

onmessage = async ({ data }) => {
  if (data.portable) {
    postMessage({ module: await start(data) });
    return;
  }
  let outcome;
  try {
    outcome = fly(data.request, data.weights);
  } catch (error) {
    // a module that has stopped in the midst of something is not used again
    outcome = { refused: `the engine has stopped: ${error.message}` };
    Object.assign(engine, await engine.make(engine.bytes));
  }
  postMessage({ id: data.id, ...outcome }, outcome.numbers ? [outcome.numbers.buffer] : []);
};
