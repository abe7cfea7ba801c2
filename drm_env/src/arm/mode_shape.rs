//! Assumed mode shapes of a clamped link.
//!
//! A family is the span of its first n functions. The functions themselves become linearly
//! dependent to rounding from n = 8 on, so a [`ShapeBasis`] holds other functions with the same
//! span: those whose curvatures are orthonormal (polynomial families) or nearly so (cosines).

use std::f64::consts::PI;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::math::quadrature::{gauss_legendre, integrate};

/// Largest number of shapes a basis holds.
pub const MAX_SHAPES: usize = 40;

/// Families of assumed mode shapes of a clamped link over u = x / length, i = 1, 2, ...
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ShapeFamily {
    /// u^(i+2) (thesis equation B.7). Without curvature at the root, so it converges badly.
    B7,
    /// (i+2) u^(i+1) - i u^(i+2) (B.8). Without curvature at the tip.
    #[default]
    B8,
    /// 1 - cos(i pi u) + (-1)^(i+1) (i pi u)^2 / 2 (B.9). Without curvature at the tip.
    B9,
    /// u^(i+1) (not in the thesis): no more than the clamp demands.
    Mono,
}

/// Value, slope (per u) and curvature (per u^2) of a shape.
pub type ShapeValue = [f64; 3];

/// Well conditioned functions with the span of the first functions of a family.
#[derive(Debug, Clone, PartialEq)]
pub struct ShapeBasis {
    kind: Kind,
}

#[derive(Debug, Clone, PartialEq)]
enum Kind {
    /// Legendre series in 2u - 1 of value, slope and curvature of each function.
    Polynomial(Vec<[Vec<f64>; 3]>),
    /// The functions of B.9 over (i pi)^2.
    Cosine(usize),
}

impl ShapeBasis {
    /// The basis of the first `count` functions.
    ///
    /// # Panics
    /// More than [`MAX_SHAPES`].
    pub fn new(family: ShapeFamily, count: usize) -> Self {
        assert!(count <= MAX_SHAPES, "at most {MAX_SHAPES} shapes");
        // the curvatures span a factor times all polynomials of degree below `count`; Jacobi
        // polynomials with the factor's square as weight make them orthogonal
        let kind = match family {
            ShapeFamily::B9 => Kind::Cosine(count),
            ShapeFamily::B7 => polynomials(count, 0.0, 2.0, |x| 1.0 + x),
            ShapeFamily::B8 => polynomials(count, 2.0, 0.0, |x| 1.0 - x),
            ShapeFamily::Mono => polynomials(count, 0.0, 0.0, |_| 1.0),
        };
        Self { kind }
    }

    /// Number of shapes.
    pub fn len(&self) -> usize {
        match &self.kind {
            Kind::Polynomial(functions) => functions.len(),
            Kind::Cosine(count) => *count,
        }
    }

    /// Whether there are none: a rigid link.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// All shapes at u from 0 to 1.
    pub fn at(&self, u: f64) -> Vec<ShapeValue> {
        match &self.kind {
            Kind::Polynomial(functions) => {
                let legendre = legendre(functions.len() + 4, 2.0 * u - 1.0);
                let sum =
                    |series: &Vec<f64>| series.iter().zip(&legendre).map(|(c, p)| c * p).sum();
                functions
                    .iter()
                    .map(|f| [sum(&f[0]), sum(&f[1]), sum(&f[2])])
                    .collect()
            }
            Kind::Cosine(count) => (1..=*count)
                .map(|i| {
                    let wave = PI * i as f64;
                    let sign = if i % 2 == 1 { 1.0 } else { -1.0 };
                    let half = libm::sin(wave * u / 2.0) / wave;
                    [
                        2.0 * half * half + sign * u * u / 2.0,
                        libm::sin(wave * u) / wave + sign * u,
                        libm::cos(wave * u) + sign,
                    ]
                })
                .collect(),
        }
    }

    /// Gauss points that integrate products of two shapes over any part of the link to rounding.
    pub fn quadrature_points(&self) -> usize {
        match &self.kind {
            Kind::Polynomial(functions) => functions.len() + 3,
            Kind::Cosine(count) => 2 * count + 24,
        }
    }
}

/// Functions of u, zero with zero slope at the root, whose curvatures are factor(x) P_k(x) with
/// x = 2u - 1 and P_k the Jacobi polynomials (a, b), scaled to unit integral of the square.
fn polynomials(count: usize, a: f64, b: f64, factor: impl Fn(f64) -> f64) -> Kind {
    let rule = gauss_legendre(count + 4);
    let functions = (0..count).map(|k| {
        let curvature = |x: f64| factor(x) * jacobi(k, a, b, x);
        let norm = libm::sqrt(integrate(&rule, -1.0, 1.0, |x| curvature(x) * curvature(x)) / 2.0);
        let series: Vec<f64> = (0..count + 1)
            .map(|degree| {
                let projected = integrate(&rule, -1.0, 1.0, |x| {
                    curvature(x) * legendre(degree + 1, x)[degree]
                });
                (degree as f64 + 0.5) * projected / norm
            })
            .collect();
        let slope = integral_from_root(&series);
        [integral_from_root(&slope), slope, series]
    });
    Kind::Polynomial(functions.collect())
}

/// Legendre series (in x = 2u - 1) of the integral over u from the root.
fn integral_from_root(series: &[f64]) -> Vec<f64> {
    let mut result = vec![0.0; series.len() + 1];
    for (degree, c) in series.iter().enumerate() {
        // the integral of P_k from -1 is (P_(k+1) - P_(k-1)) / (2k + 1), of P_0 it is P_1 + P_0
        let part = c / 2.0 / (2.0 * degree as f64 + 1.0);
        result[degree + 1] += part;
        if degree == 0 {
            result[0] += part;
        } else {
            result[degree - 1] -= part;
        }
    }
    result
}

/// Legendre polynomials of degree 0 to count - 1 at x.
fn legendre(count: usize, x: f64) -> Vec<f64> {
    let mut values = Vec::with_capacity(count);
    let (mut p, mut previous) = (1.0, 0.0);
    for k in 0..count {
        values.push(p);
        let k = k as f64;
        (p, previous) = (((2.0 * k + 1.0) * x * p - k * previous) / (k + 1.0), p);
    }
    values
}

/// Jacobi polynomial of degree k at x, by the three-term recurrence.
fn jacobi(k: usize, a: f64, b: f64, x: f64) -> f64 {
    let (mut p, mut previous) = (1.0, 0.0);
    for n in 1..=k {
        let n = n as f64;
        let next = if n == 1.0 {
            (a + 1.0) + (a + b + 2.0) * (x - 1.0) / 2.0
        } else {
            let s = 2.0 * n + a + b;
            ((s - 1.0) * (s * (s - 2.0) * x + a * a - b * b) * p
                - 2.0 * (n + a - 1.0) * (n + b - 1.0) * s * previous)
                / (2.0 * n * (n + a + b) * (s - 2.0))
        };
        (p, previous) = (next, p);
    }
    p
}
