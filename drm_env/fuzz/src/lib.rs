//! What the targets of cargo-fuzz share; `Cargo.toml` says how they are run.

pub mod doors;
