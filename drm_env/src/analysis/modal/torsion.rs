//! Twist of the arm about its axis: a massless shaft of tubes with the payload at its end
//! (thesis Table 2-12).

use std::f64::consts::PI;

/// A round tube.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tube {
    /// Outer diameter, m.
    pub outer: f64,
    /// Inner diameter, m.
    pub inner: f64,
    /// G, Pa.
    pub shear_modulus: f64,
}

/// The thesis' link 1.
pub const LINK1: Tube = Tube {
    outer: 0.20,
    inner: 0.18,
    shear_modulus: 30.4e9,
};

/// The thesis' link 2.
pub const LINK2: Tube = Tube {
    outer: 0.18,
    inner: 0.16,
    shear_modulus: 50.4e9,
};

/// Both links side by side.
pub const OVERLAP: Tube = Tube {
    outer: 0.20,
    inner: 0.16,
    shear_modulus: 33.5e9,
};

impl Tube {
    /// Second moment of area for bending, m^4.
    pub fn area_moment(&self) -> f64 {
        let fourth = |d: f64| d * d * d * d;
        PI * (fourth(self.outer) - fourth(self.inner)) / 64.0
    }

    /// Cross-section, m^2.
    pub fn area(&self) -> f64 {
        PI * (self.outer * self.outer - self.inner * self.inner) / 4.0
    }

    /// G J, N m^2.
    pub fn torsional_stiffness(&self) -> f64 {
        2.0 * self.shear_modulus * self.area_moment()
    }
}

/// Angular frequency (rad/s) of a payload with moment of inertia `inertia` (kg m^2, about the
/// arm's axis) at the end of tubes of the given lengths (m), held at the other end.
pub fn frequency(shaft: &[(f64, Tube)], inertia: f64) -> f64 {
    let compliance: f64 = shaft
        .iter()
        .map(|(length, tube)| length / tube.torsional_stiffness())
        .sum();
    1.0 / libm::sqrt(inertia * compliance)
}
