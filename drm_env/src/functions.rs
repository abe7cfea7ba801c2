//! Elementary functions of lanes (placeholder).
use crate::lane::Number;

/// ln(1 + x).
pub fn ln_1p<T: Number>(x: T) -> T {
    let mut y = x;
    for i in 0..T::WIDTH {
        y.set_lane(i, libm::log1p(x.lane(i)));
    }
    y
}

/// asinh(x).
pub fn asinh<T: Number>(x: T) -> T {
    let mut y = x;
    for i in 0..T::WIDTH {
        y.set_lane(i, libm::asinh(x.lane(i)));
    }
    y
}
