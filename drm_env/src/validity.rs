//! How far the equations of motion hold: beyond these limits a flight is void, whoever flies it.
//!
//! Both plants bend by the linear theory of slender beams, about an axis that turns. Their numbers go on
//! growing where an arm would long have broken, so every door asks here: environments, laws, given
//! torques, networks and linear models end a flight that leaves these limits and call it diverged.

/// Largest deflection of the tip, as a part of the arm's reach. A cantilever bent so far by a force at
/// its tip has a slope of 3/2 of this: 0.375. The linear theory takes the curvature w'' for
/// w'' / (1 + w'^2)^(3/2), a fifth less there, and leaves out that the tip draws near.
pub const LARGEST_DEFLECTION: f64 = 0.25;

/// Largest slew error, rad: one turn. Beyond it the arm is where another error has it too, and the
/// flight, whose open loop, laws and metrics are all about this error, is no longer the manoeuvre.
pub const LARGEST_SLEW_ERROR: f64 = std::f64::consts::TAU;
