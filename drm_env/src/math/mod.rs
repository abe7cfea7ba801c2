//! Numerical methods that know nothing of the arm: time integration, quadrature, random streams.

pub mod generalized_alpha;
pub mod quadrature;
pub mod rng;
pub mod runge_kutta;
