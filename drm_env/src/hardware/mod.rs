//! What stands between a command and the ideal arm, and between the arm and who reads it: reaction
//! wheels, the slew motor, delay and noise.

pub(crate) mod delay;
pub mod reaction_wheel;
pub mod sensors;
pub mod slew_motor;
