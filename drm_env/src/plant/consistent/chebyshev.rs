//! Functions of the length as Chebyshev series, evaluated side by side.

use crate::simd::Lane;

/// Largest number of terms of a series.
const LONGEST: usize = 128;
/// Terms for which polynomial shapes have a short way.
const SHORT: usize = 16;
/// Series evaluated side by side.
pub(super) const GROUP: usize = 8;
/// Part of an entry's size below which the rest of its series is rounding.
const ROUNDING: f64 = 5e-16;

/// The lengths at which functions are sampled, and the polynomials on them.
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

    /// Coefficients of the series through values at the nodes, up to what is rounding of a function
    /// as large as `scale`.
    fn series(&self, values: &[f64], scale: f64) -> Vec<f64> {
        let mut series: Vec<f64> = (0..self.nodes)
            .map(|order| {
                let sum: f64 = values
                    .iter()
                    .enumerate()
                    .map(|(node, value)| value * self.polynomial(order, node))
                    .sum();
                sum * if order == 0 { 1.0 } else { 2.0 } / self.nodes as f64
            })
            .collect();
        let terms = series
            .iter()
            .rposition(|c| c.abs() > ROUNDING * scale)
            .map_or(0, |last| last + 1);
        series.truncate(terms);
        series
    }
}

/// A function sampled at the nodes of an interval, and the size by which its rounding is measured.
#[derive(Debug, Clone)]
pub(super) struct Sampled {
    pub values: Vec<f64>,
    pub scale: f64,
}

/// [`GROUP`] series, interleaved.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Group {
    terms: usize,
    /// First coefficient.
    start: usize,
}

/// Functions of the length.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Table {
    middle: f64,
    per_half: f64,
    longest: usize,
    groups: Vec<Group>,
    coefficients: Vec<f64>,
}

impl Table {
    /// Series of functions sampled at the nodes of an interval.
    pub fn new(interval: &Interval, functions: &[Sampled]) -> Self {
        let mut table = Self {
            middle: interval.middle,
            per_half: 1.0 / interval.half,
            longest: 0,
            groups: Vec::new(),
            coefficients: Vec::new(),
        };
        for group in functions.chunks(GROUP) {
            let series: Vec<Vec<f64>> = group
                .iter()
                .map(|function| interval.series(&function.values, function.scale))
                .collect();
            let terms = series.iter().map(Vec::len).max().unwrap_or(0);
            table.groups.push(Group {
                terms,
                start: table.coefficients.len(),
            });
            for order in 0..terms {
                for function in 0..GROUP {
                    let series = series.get(function);
                    let c = series.and_then(|series| series.get(order)).copied();
                    table.coefficients.push(c.unwrap_or(0.0));
                }
            }
            table.longest = table.longest.max(terms);
        }
        table
    }

    /// Writes all functions at the length `a`.
    #[inline(always)]
    pub fn evaluate<T: Lane>(&self, a: T, out: &mut [T]) {
        if self.longest <= SHORT {
            self.evaluate_within::<T, SHORT>(a, out);
        } else {
            self.evaluate_within::<T, LONGEST>(a, out);
        }
    }

    #[inline(always)]
    fn evaluate_within<T: Lane, const TERMS: usize>(&self, a: T, out: &mut [T]) {
        let x = (a - self.middle) * self.per_half;
        let twice = x + x;
        let mut basis = [T::splat(0.0); TERMS];
        let (mut before, mut now) = (x, T::splat(1.0));
        for value in basis.iter_mut().take(self.longest) {
            *value = now;
            (before, now) = (now, twice.mul_add(now, -before));
        }
        // by numbers and not by iterators: in as large a function as a step these are not inlined
        for index in 0..out.len() / GROUP {
            let group = self.groups[index];
            let terms = group.terms.min(TERMS);
            let series = &self.coefficients[group.start..group.start + terms * GROUP];
            let mut sum = [T::splat(0.0); GROUP];
            for order in 0..terms {
                let term = &series[order * GROUP..][..GROUP];
                for k in 0..GROUP {
                    sum[k] = T::splat(term[k]).mul_add(basis[order], sum[k]);
                }
            }
            out[index * GROUP..][..GROUP].copy_from_slice(&sum);
        }
    }
}
