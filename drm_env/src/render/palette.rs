//! Every colour of the project's pictures; Python's pictures ask for the same.

/// Red, green and blue, 0 to 255.
pub type Rgb = [u8; 3];

/// The colours of Okabe and Ito, which readers with any common colour blindness can tell apart, and a
/// grey, by name.
pub const PALETTE: [(&str, Rgb); 9] = [
    ("black", [0, 0, 0]),
    ("orange", [230, 159, 0]),
    ("sky blue", [86, 180, 233]),
    ("green", [0, 158, 115]),
    ("yellow", [240, 228, 66]),
    ("blue", BLUE),
    ("vermilion", VERMILION),
    ("purple", PURPLE),
    ("grey", [119, 119, 119]),
];

/// What is drawn where no policy has given it its colour.
pub(super) const BLUE: Rgb = [0, 114, 178];
/// What needs attention: a saturated wheel, a flight that has diverged.
pub(super) const VERMILION: Rgb = [213, 94, 0];
/// The target.
pub(super) const PURPLE: Rgb = [204, 121, 167];

/// Behind everything.
pub(super) const PAPER: Rgb = [255, 255, 255];
/// Behind header and panels.
pub(super) const PANEL: Rgb = [246, 247, 249];
/// The sector that the manoeuvre sweeps.
pub(super) const FIELD: Rgb = [247, 249, 251];
/// Rules and grids.
pub(super) const FAINT: Rgb = [219, 224, 230];
/// Empty gauges.
pub(super) const TROUGH: Rgb = [228, 232, 237];
/// Labels.
pub(super) const GREY: Rgb = [98, 108, 120];
/// Structure: link 1, wheels.
pub(super) const STEEL: Rgb = [84, 96, 110];
/// Values, the reference.
pub(super) const INK: Rgb = [30, 37, 46];

/// `share` of the way from one colour to another.
pub(super) fn between(from: Rgb, to: Rgb, share: f64) -> Rgb {
    std::array::from_fn(|i| {
        let (a, b) = (f64::from(from[i]), f64::from(to[i]));
        (a + (b - a) * share).round() as u8
    })
}
