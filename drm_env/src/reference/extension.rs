//! The length of link 2 outside link 1 at one instant.

use crate::simd::laned;

/// Extension of link 2 with its derivatives at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extension<T> {
    /// Length outside link 1, a, m.
    pub length: T,
    /// da/dt, m/s.
    pub rate: T,
    /// d2a/dt2, m/s^2.
    pub accel: T,
}

laned!(Extension {
    length,
    rate,
    accel
});
