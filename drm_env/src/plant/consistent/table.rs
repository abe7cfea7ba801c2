//! Matrices that depend on the length, as Chebyshev series of their entries.
//!
//! An integral over link 2's own shapes is a short polynomial of the length a over a power of a,
//! every other one a polynomial (or entire) function: so the series of an entry times that power ends
//! at rounding after few terms.

use nalgebra::DMatrix;

/// Largest number of terms of a series.
pub(super) const LONGEST: usize = 128;
/// Entries evaluated side by side.
const WIDTH: usize = 8;
/// Part of an entry's size below which the rest of its series is rounding.
const ROUNDING: f64 = 5e-16;

/// The lengths at which a table samples, and the polynomials on them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Interval {
    middle: f64,
    half: f64,
    nodes: usize,
    /// cos(pi i / (2 nodes)) over a whole turn.
    cosines: Vec<f64>,
}

impl Interval {
    pub fn new(low: f64, high: f64, nodes: usize) -> Self {
        let nodes = nodes.min(LONGEST);
        let step = std::f64::consts::PI / (2 * nodes) as f64;
        Self {
            middle: (low + high) / 2.0,
            half: (high - low) / 2.0,
            nodes,
            cosines: (0..4 * nodes).map(|i| libm::cos(i as f64 * step)).collect(),
        }
    }

    /// The Chebyshev polynomial of an order at a node.
    fn polynomial(&self, order: usize, node: usize) -> f64 {
        self.cosines[order * (2 * node + 1) % self.cosines.len()]
    }

    /// Lengths at the Chebyshev nodes.
    pub fn lengths(&self) -> Vec<f64> {
        (0..self.nodes)
            .map(|node| self.middle + self.half * self.polynomial(1, node))
            .collect()
    }

    /// Coefficients of the series through values at the nodes.
    fn series(&self, values: &[f64]) -> Vec<f64> {
        (0..self.nodes)
            .map(|order| {
                let sum: f64 = values
                    .iter()
                    .enumerate()
                    .map(|(node, value)| value * self.polynomial(order, node))
                    .sum();
                sum * if order == 0 { 1.0 } else { 2.0 } / self.nodes as f64
            })
            .collect()
    }

    /// Derivative with respect to the length, at the nodes, of a function known there.
    fn derivative(&self, values: &[f64]) -> Vec<f64> {
        let mut series = self.series(values);
        let size = series.iter().fold(0.0, |size: f64, c| size.max(c.abs()));
        let terms = ending(&series, ROUNDING * size);
        series.truncate(terms);
        let mut slope = vec![0.0; terms + 2];
        for order in (1..terms).rev() {
            slope[order - 1] = slope[order + 1] + 2.0 * order as f64 * series[order];
        }
        slope[0] /= 2.0;
        (0..self.nodes)
            .map(|node| {
                let terms = slope.iter().enumerate();
                let sum: f64 = terms
                    .map(|(order, c)| c * self.polynomial(order, node))
                    .sum();
                sum / self.half
            })
            .collect()
    }
}

/// Number of terms before all are at most `negligible`.
fn ending(series: &[f64], negligible: f64) -> usize {
    series
        .iter()
        .rposition(|c| c.abs() > negligible)
        .map_or(0, |last| last + 1)
}

/// One matrix at every node of an interval. `plain` is the number of leading coordinates between
/// which entries need no power of the length; the others are multiplied by a^`power`.
#[derive(Debug, Clone)]
pub(super) struct Sampled {
    pub values: Vec<DMatrix<f64>>,
    pub power: usize,
    pub plain: usize,
}

impl Sampled {
    fn power(&self, i: usize, j: usize) -> usize {
        if i.max(j) < self.plain { 0 } else { self.power }
    }

    fn entry(&self, i: usize, j: usize) -> impl Iterator<Item = f64> {
        self.values.iter().map(move |m| m[(i, j)])
    }

    /// dX/da; of one power more.
    pub fn derivative(&self, interval: &Interval) -> Self {
        let lengths = interval.lengths();
        let mut result = self.clone();
        result.power += 1;
        let (rows, columns) = self.values[0].shape();
        for i in 0..rows {
            for j in 0..columns {
                let power = self.power(i, j) as i32;
                // X = Q / a^p: X_a = (Q_a - p Q / a) / a^p
                let cleared: Vec<f64> = self
                    .entry(i, j)
                    .zip(&lengths)
                    .map(|(x, a)| x * a.powi(power))
                    .collect();
                let slope = interval.derivative(&cleared);
                for (node, a) in lengths.iter().enumerate() {
                    let clear = slope[node] - f64::from(power) * cleared[node] / a;
                    result.values[node][(i, j)] = clear / a.powi(power);
                }
            }
        }
        result
    }

    /// Node by node.
    pub fn map(&self, power: usize, f: impl Fn(usize, &DMatrix<f64>) -> DMatrix<f64>) -> Self {
        Self {
            values: self
                .values
                .iter()
                .enumerate()
                .map(|(node, m)| f(node, m))
                .collect(),
            power,
            plain: self.plain,
        }
    }
}

/// Up to [`WIDTH`] series of the same power.
#[derive(Debug, Clone, PartialEq)]
struct Chunk {
    power: usize,
    terms: usize,
    /// First coefficient; the series of a chunk are interleaved.
    start: usize,
    count: usize,
    /// Where each value goes, and where its mirror image does.
    targets: [[u16; 2]; WIDTH],
}

/// Several matrices of one size as functions of the length.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Table {
    middle: f64,
    half: f64,
    chunks: Vec<Chunk>,
    coefficients: Vec<f64>,
    longest: usize,
}

impl Table {
    /// Series of every entry of `matrices`; a symmetric matrix is evaluated by its lower triangle.
    pub fn new(interval: &Interval, matrices: &[&Sampled]) -> Self {
        let lengths = interval.lengths();
        let mut entries: Vec<(usize, Vec<f64>, [u16; 2])> = Vec::new();
        for (slot, matrix) in matrices.iter().enumerate() {
            let size = matrix.values[0].nrows();
            let cleared = |i: usize, j: usize| -> Vec<f64> {
                let power = matrix.power(i, j) as i32;
                matrix
                    .entry(i, j)
                    .zip(&lengths)
                    .map(|(x, a)| x * a.powi(power))
                    .collect()
            };
            let largest = |values: &[f64]| values.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
            let sizes = DMatrix::from_fn(size, size, |i, j| largest(&cleared(i, j)));
            let symmetric = matrix
                .values
                .iter()
                .all(|m| (m - m.transpose()).amax() <= 1e-14 * m.amax());
            for i in 0..size {
                for j in 0..size {
                    if symmetric && j > i {
                        continue;
                    }
                    // rounding of the quadrature grows with what an entry could be
                    let scale = libm::sqrt(sizes.row(i).max() * sizes.column(j).max());
                    let mut series = interval.series(&cleared(i, j));
                    let terms = ending(&series, ROUNDING * scale);
                    series.truncate(terms);
                    if terms > 0 {
                        let target = |i, j| (slot * size * size + i * size + j) as u16;
                        let mirror = if symmetric {
                            target(j, i)
                        } else {
                            target(i, j)
                        };
                        entries.push((matrix.power(i, j), series, [target(i, j), mirror]));
                    }
                }
            }
        }
        entries.sort_by_key(|(power, series, _)| (*power, series.len()));
        let mut table = Self {
            middle: interval.middle,
            half: interval.half,
            chunks: Vec::new(),
            coefficients: Vec::new(),
            longest: entries
                .iter()
                .map(|(_, series, _)| series.len())
                .max()
                .unwrap_or(0),
        };
        for same_power in entries.chunk_by(|one, other| one.0 == other.0) {
            for group in same_power.chunks(WIDTH) {
                let terms = group
                    .iter()
                    .map(|(_, series, _)| series.len())
                    .max()
                    .unwrap_or(0);
                let start = table.coefficients.len();
                for order in 0..terms {
                    for lane in 0..WIDTH {
                        let series = group.get(lane).map(|(_, series, _)| series);
                        let c = series.and_then(|series| series.get(order)).copied();
                        table.coefficients.push(c.unwrap_or(0.0));
                    }
                }
                let mut targets = [[0; 2]; WIDTH];
                for (target, (_, _, to)) in targets.iter_mut().zip(group) {
                    *target = *to;
                }
                table.chunks.push(Chunk {
                    power: same_power[0].0,
                    terms,
                    start,
                    count: group.len(),
                    targets,
                });
            }
        }
        table
    }

    /// Writes the matrices at the length `a`, one after another and rows first, over zeros.
    #[inline(always)]
    pub fn evaluate(&self, a: f64, out: &mut [f64]) {
        let x = (a - self.middle) / self.half;
        let mut basis = [0.0; LONGEST];
        let (mut before, mut now) = (x, 1.0);
        for value in basis.iter_mut().take(self.longest) {
            *value = now;
            (before, now) = (now, 2.0 * x * now - before);
        }
        let mut powers = [1.0; 8];
        for k in 1..powers.len() {
            powers[k] = powers[k - 1] / a;
        }
        for chunk in &self.chunks {
            let mut sum = [0.0; WIDTH];
            let series = &self.coefficients[chunk.start..chunk.start + chunk.terms * WIDTH];
            for (term, value) in series.chunks_exact(WIDTH).zip(&basis) {
                for (sum, c) in sum.iter_mut().zip(term) {
                    *sum += c * value;
                }
            }
            let scale = powers[chunk.power];
            for (value, [to, mirror]) in sum.iter().zip(&chunk.targets).take(chunk.count) {
                out[usize::from(*to)] = value * scale;
                out[usize::from(*mirror)] = value * scale;
            }
        }
    }
}
