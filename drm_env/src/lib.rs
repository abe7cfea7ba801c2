//! Dynamics, control laws and batched environments of the Deployable Robotic Manipulator: a slewing
//! link with a second link that slides out of it, both flexible, a payload at the tip, and two small
//! reaction wheels.
//!
//! **Frame and signs.** Everything moves in the plane. `theta` is the slew angle at the shoulder,
//! counter-clockwise positive; deflections are measured from the rotating axis, positive the same
//! way round. Torques act on the arm.
//!
//! **State.** q = (theta, alpha, beta): slew angle (rad) and the modal coordinates of link 1 and
//! link 2, each half the deflection of its link's tip (m); the tip of the arm is deflected by
//! 2 (alpha + beta). The length of link 2 outside link 1 is prescribed.
//!
//! **Units.** SI and radians throughout.
//!
//! # Map
//! From the ground up, each room knowing only those before it: [`error`]; [`simd`], the number type of
//! the physics and its instructions; [`math`]; [`arm`]; [`hardware`]; [`reference`], what is prescribed;
//! [`control`], the laws; [`plant`], the equations of motion; [`config`], manoeuvres and environments as
//! data; [`simulation`], manoeuvres flown sample by sample; [`mod@env`], episodes: observation, reward,
//! end; [`render`]; [`rollout`] and [`batch`], many at once; [`analysis`]; [`benchmark`].

pub mod analysis;
pub mod arm;
pub mod batch;
pub mod benchmark;
mod check;
pub mod config;
pub mod control;
pub mod env;
pub mod error;
pub mod hardware;
pub mod interruption;
pub mod math;
pub mod memory;
pub mod plant;
pub mod reference;
pub mod render;
pub mod rollout;
pub mod simd;
pub mod simulation;
pub mod validity;

pub use analysis::model::Model;
pub use config::EnvConfig;
pub use config::scenario::Scenario;
pub use env::Env;
pub use error::{ConfigError, Error, SimulationError, SnapshotError};
