//! Bindings of the engine for a page in a browser: JSON text in, text and numbers out. They translate; they
//! decide and compute nothing.
//!
//! [`flight::fly`] is what the page asks for. [`exports`] is how it gets there without any generated code:
//! plain functions on the memory of the WebAssembly module, which `page/engine.js` calls.

pub mod exports;
pub mod flight;
