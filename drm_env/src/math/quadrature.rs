//! Gauss-Legendre quadrature.

/// Nodes and weights on [-1, 1], by Newton's iteration on the Legendre polynomial.
pub fn gauss_legendre(points: usize) -> Vec<(f64, f64)> {
    let n = points as f64;
    (0..points)
        .map(|i| {
            let mut x = libm::cos(std::f64::consts::PI * (i as f64 + 0.75) / (n + 0.5));
            let mut slope = 1.0;
            for _ in 0..100 {
                let (mut p, mut previous) = (1.0, 0.0);
                for k in 0..points {
                    let k = k as f64;
                    (p, previous) = (((2.0 * k + 1.0) * x * p - k * previous) / (k + 1.0), p);
                }
                slope = n * (x * p - previous) / (x * x - 1.0);
                let correction = p / slope;
                x -= correction;
                if correction.abs() < 1e-15 {
                    break;
                }
            }
            (x, 2.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

/// Integral of `f` over `low ..= high` with the given rule.
pub fn integrate(rule: &[(f64, f64)], low: f64, high: f64, f: impl Fn(f64) -> f64) -> f64 {
    let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
    rule.iter()
        .map(|&(x, weight)| weight * half * f(middle + half * x))
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ten_points_integrate_degree_nineteen_exactly() {
        let rule = gauss_legendre(10);
        for degree in 0..20 {
            let value = integrate(&rule, 0.0, 2.0, |x| x.powi(degree));
            let exact = 2.0_f64.powi(degree + 1) / f64::from(degree + 1);
            assert!((value - exact).abs() < 1e-13 * exact, "degree {degree}");
        }
    }
}
