//! The functions of the WebAssembly module. A caller writes into memory that it has been given by
//! [`allocate`], asks with [`fly`], reads the [`Reply`], and gives everything back.

use std::alloc::{Layout, alloc, dealloc};
use std::slice::from_raw_parts;

use crate::flight;

/// What came of a request, at an address that the caller reads.
#[repr(C)]
pub struct Reply {
    /// 1 if the text says why nothing was flown, else 0.
    refused: usize,
    /// Address and bytes of the text, UTF-8: the contents as JSON, or an error.
    text: [usize; 2],
    /// Address and count of the numbers.
    numbers: [usize; 2],
    held: (String, Vec<f64>),
}

fn layout(bytes: usize) -> Option<Layout> {
    Layout::from_size_align(bytes.max(1), 8).ok()
}

/// 1 if flights have the bits of every other machine here, else 0: the module that was compiled without relaxed
/// instructions has to be taken then.
#[unsafe(no_mangle)]
pub extern "C" fn exact() -> u32 {
    u32::from(drm_env::simd::is_fused())
}

/// Memory of so many bytes; null if there is none.
#[unsafe(no_mangle)]
pub extern "C" fn allocate(bytes: usize) -> *mut u8 {
    // SAFETY: the layout has at least one byte
    layout(bytes).map_or(std::ptr::null_mut(), |layout| unsafe { alloc(layout) })
}

/// Gives memory back.
///
/// # Safety
/// It came from [`allocate`], of so many bytes, and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn release(memory: *mut u8, bytes: usize) {
    if let Some(layout) = layout(bytes).filter(|_| !memory.is_null()) {
        // SAFETY: the caller's
        unsafe { dealloc(memory, layout) }
    }
}

/// Flies what a request says; see [`flight::fly`].
///
/// # Safety
/// Text and weights are memory of that many bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fly(
    text: *const u8,
    text_bytes: usize,
    weights: *const u8,
    weights_bytes: usize,
) -> *mut Reply {
    // SAFETY: the caller's
    let (text, weights) = unsafe {
        (
            from_raw_parts(text, text_bytes),
            from_raw_parts(weights, weights_bytes),
        )
    };
    let text = String::from_utf8_lossy(text);
    let (refused, text, numbers) = match flight::fly(&text, weights) {
        Ok(flown) => {
            let contents = serde_json::to_string(&flown.contents).unwrap_or_default();
            (0, contents, flown.numbers)
        }
        Err(error) => (1, error.to_string(), Vec::new()),
    };
    Box::into_raw(Box::new(Reply {
        refused,
        text: [text.as_ptr() as usize, text.len()],
        numbers: [numbers.as_ptr() as usize, numbers.len()],
        held: (text, numbers),
    }))
}

/// Gives a reply back.
///
/// # Safety
/// It came from [`fly`], and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn forget(reply: *mut Reply) {
    // SAFETY: the caller's
    drop(unsafe { Box::from_raw(reply) }.held);
}
