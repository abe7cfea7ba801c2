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
//! [`arm`], [`plant`], [`shape`], [`modal`], [`linear`], [`model`]: the mechanics. [`profile`], [`deployment`],
//! [`timeline`]: what is prescribed. [`actuator`], [`motor`], [`integrator`], [`implicit`], [`lane`],
//! [`quadrature`], [`rng`]: parts that know nothing of the arm. [`control`]: the laws.
//! [`scenario`], [`distribution`], [`parameter`], [`options`], [`config`]: manoeuvres and environments as data.
//! [`body`], [`flight`], [`validity`], [`metrics`], [`task`], [`mod@env`], [`batch`], [`rollout`], [`network`]: what flies them;
//! [`transition`]: the linear model of a whole manoeuvre. [`interruption`]: how long work ends early;
//! [`memory`]: what fits.
//! [`render`], [`scene`]: pictures.

pub mod actuator;
pub mod arm;
pub mod batch;
pub mod benchmark;
mod body;
mod cohort;
pub mod config;
pub mod control;
mod crew;
pub mod deployment;
pub mod distribution;
pub mod env;
pub mod error;
pub mod flight;
pub mod functions;
pub mod implicit;
pub mod integrator;
pub mod interruption;
pub mod lane;
mod leg;
pub mod linear;
mod lines;
pub mod memory;
pub mod metrics;
pub mod modal;
pub mod model;
pub mod motor;
pub mod network;
pub mod options;
pub mod parameter;
mod plan;
pub mod plant;
mod pool;
pub mod profile;
pub mod quadrature;
pub mod render;
pub mod rng;
pub mod rollout;
pub mod scenario;
pub mod scene;
pub mod shape;
pub mod task;
pub mod timeline;
pub mod transition;
pub mod validity;
mod vector;
mod witness;

pub use config::EnvConfig;
pub use env::Env;
pub use error::{ConfigError, Error, SimulationError, SnapshotError};
pub use model::Model;
pub use scenario::Scenario;
