//! What is prescribed: the slew profile, the deployment of link 2, and the timeline of both.

pub mod deployment;
pub mod extension;
pub mod series;
pub mod shaped;
pub mod shaping;
pub mod slew;
pub mod timeline;

pub use extension::Extension;
