//! Numbers as texts.

/// A number no wider than about nine characters; "n/a" when it is not finite. A minus is one.
pub(super) fn number(value: f64, decimals: usize, signed: bool) -> String {
    ascii_number(value, decimals, signed).replace('-', "\u{2212}")
}

/// [`number`] with a hyphen for a minus.
pub(super) fn ascii_number(value: f64, decimals: usize, signed: bool) -> String {
    if !value.is_finite() {
        "n/a".to_owned()
    } else if value.abs() >= 1e6 {
        format!("{value:.1e}")
    } else {
        // Adding zero turns a rounded-away minus into a plus.
        let power = 10f64.powi(decimals as i32);
        let value = (value * power).round() / power + 0.0;
        if signed {
            format!("{value:+.decimals$}")
        } else {
            format!("{value:.decimals$}")
        }
    }
}

/// A length of metres with its unit: millimetres, or metres where these are too many.
pub(super) fn millimetres(length: f64) -> String {
    if length.abs() >= 10.0 {
        return format!("{} m", number(length, 2, true));
    }
    let decimals = if length.abs() < 0.1 { 2 } else { 1 };
    format!("{} mm", number(length * 1e3, decimals, true))
}

/// A factor, such as that of the deflections.
pub(super) fn factor(value: f64) -> String {
    let whole = value >= 10.0 || value.fract() == 0.0;
    ascii_number(value, if whole { 0 } else { 2 }, false)
}

/// What is reported beside what is true, such as "+15 %"; "as it is" where it is the same.
pub(super) fn misreport(truth: f64, reported: f64) -> String {
    if truth == reported {
        return "as it is".to_owned();
    }
    if truth > 0.0 {
        return format!("{} %", number((reported / truth - 1.0) * 100.0, 1, true));
    }
    "there is none".to_owned()
}
