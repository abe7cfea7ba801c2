// The amplitude spectrum of a signal.

/** Fast Fourier transform in place; the length is a power of two. */
function transform(real, imaginary) {
  const n = real.length;
  for (let i = 1, j = 0; i < n; i++) {
    let bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) {
      [real[i], real[j]] = [real[j], real[i]];
      [imaginary[i], imaginary[j]] = [imaginary[j], imaginary[i]];
    }
  }
  for (let size = 2; size <= n; size <<= 1) {
    for (let k = 0; k < size / 2; k++) {
      const angle = (-2 * Math.PI * k) / size;
      const [c, s] = [Math.cos(angle), Math.sin(angle)];
      for (let i = k; i < n; i += size) {
        const j = i + size / 2;
        const x = real[j] * c - imaginary[j] * s;
        const y = real[j] * s + imaginary[j] * c;
        real[j] = real[i] - x;
        imaginary[j] = imaginary[i] - y;
        real[i] += x;
        imaginary[i] += y;
      }
    }
  }
}

/**
 * Amplitudes of the sines in samples `from` to `to`, with a Hann window and the mean taken out.
 * Returns {frequency, amplitude} as lists; Hz, and the unit of the signal.
 */
export function spectrum(values, from, to, rate, size = 2048) {
  const count = to - from;
  const real = new Float64Array(size);
  const imaginary = new Float64Array(size);
  let mean = 0;
  for (let i = from; i < to; i++) mean += values[i] / count;
  for (let i = 0; i < count; i++) {
    real[i] = (values[from + i] - mean) * (0.5 - 0.5 * Math.cos((2 * Math.PI * (i + 0.5)) / count));
  }
  transform(real, imaginary);
  const half = size / 2;
  const frequency = new Float64Array(half);
  const amplitude = new Float64Array(half);
  for (let i = 0; i < half; i++) {
    frequency[i] = (i * rate) / size;
    // a Hann window halves a sine, whose amplitude is twice its part at one frequency
    amplitude[i] = (4 * Math.hypot(real[i], imaginary[i])) / count;
  }
  return { frequency, amplitude };
}
