//! The equations for people who want them: matrices, energies, natural frequencies, linear models.

pub mod linearization;
pub mod modal;
pub mod model;
pub mod prescribed;
pub mod transitions;

pub use model::Model;
