//! One frame of the arm seen from above: an RGB raster for video and a text picture for terminals.
//!
//! World coordinates are metres with the shoulder at the origin, x along slew angle zero and y to
//! the left of it, so positive angles and deflections turn counter-clockwise in the picture.

mod canvas;
pub mod from_simulation;

use std::f64::consts::{PI, TAU};

use canvas::Canvas;

/// What one frame shows. Lengths and deflections are in metres, angles in radians.
///
/// Nothing is required to be finite: a part whose numbers are not is left out of the picture.
#[derive(Clone, Copy, Debug)]
pub struct Scene {
    /// Length of link 1, m.
    pub link1_length: f64,
    /// Length of link 2, m, whether inside link 1 or outside.
    pub link2_length: f64,
    /// Slew angle of the rotating axis, rad.
    pub slew_angle: f64,
    /// Slew angle the reference trajectory asks for now, rad.
    pub reference_angle: f64,
    /// Slew angle at the end of the manoeuvre, rad; it alone chooses the camera in normal use.
    pub target_angle: f64,
    /// Length of link 2 outside link 1, m.
    pub extension: f64,
    /// Modal coordinate of link 1, m: y1(x) = alpha phi(x / L1), phi(u) = 3 u^2 - u^3.
    pub alpha: f64,
    /// Modal coordinate of link 2, m: y2(x) = beta phi(x / extension), on top of y1(L1).
    pub beta: f64,
    /// What the end slope of link 1 adds to the deflection of link 2's tip, m; 0 where link 2 does
    /// not turn.
    pub turning: f64,
    /// Payload length along the arm, m.
    pub payload_length: f64,
    /// Payload width across the arm, m.
    pub payload_width: f64,
    /// Payload mass, kg.
    pub payload_mass: f64,
    /// Root wheel torque as a fraction of its limit, -1 to 1.
    pub root_torque: f64,
    /// Tip wheel torque as a fraction of its limit, -1 to 1.
    pub tip_torque: f64,
    /// Time since the start of the manoeuvre, s.
    pub time: f64,
    /// Time at which the reference slew ends, s.
    pub slew_end_time: f64,
    /// Tip deflection from the rotating axis, m.
    pub tip_deflection: f64,
    /// Distance of the tip from its reference, m.
    pub tip_error: f64,
    /// Factor by which deflections are drawn larger than they are.
    pub magnification: f64,
}

type Point = (f64, f64);
type Rgb = [u8; 3];

// The Okabe-Ito palette, which readers with any common colour blindness can tell apart.
const BLUE: Rgb = [0, 114, 178];
const ORANGE: Rgb = [230, 159, 0];
const GREEN: Rgb = [0, 158, 115];
const VERMILION: Rgb = [213, 94, 0];
const PURPLE: Rgb = [170, 70, 130];
const PAPER: Rgb = [252, 252, 250];
const PANEL: Rgb = [240, 242, 244];
const FAINT: Rgb = [214, 219, 224];
const GREY: Rgb = [130, 138, 146];
const INK: Rgb = [38, 46, 56];

/// Largest drawn deflection as a fraction of the reach; beyond it the factor is reduced.
const MAX_DRAWN_DEFLECTION: f64 = 0.35;
/// Smallest drawn side of a payload as a fraction of the reach, so that small ones stay visible.
const MIN_DRAWN_PAYLOAD: f64 = 0.012;
/// Largest drawn turn of the payload against the axis, rad.
const MAX_DRAWN_SLOPE: f64 = PI / 3.0;

/// Draw `scene` as `height * width * 3` bytes of row-major RGB.
///
/// Text is left out of pictures too small to hold it, apart from the magnification. The camera
/// depends on the target, not on the motion, unless the arm leaves the camera's sector. A size
/// the rasteriser cannot hold gives a blank picture; a zero size gives an empty buffer.
pub fn draw(scene: &Scene, width: u32, height: u32) -> Vec<u8> {
    let Some(mut canvas) = Canvas::new(width, height, PAPER) else {
        return vec![255; width as usize * height as usize * 3];
    };
    let (w, h) = (f64::from(width), f64::from(height));
    let unit = w.min(h) / 640.0;
    let glyph = 10.0 * unit;
    let with_text = glyph >= 5.0;
    let shown = if with_text { unit } else { 0.0 };
    let (header, footer) = (80.0 * shown, 36.0 * shown);
    let pad = if with_text { 30.0 * unit } else { 6.0 };
    let arm = Arm::new(scene);
    let frame = (pad, header + pad, w - pad, h - footer - pad);
    let view = View::new(scene, arm.reach, frame);

    let label = with_text.then_some(glyph);
    draw_dial(&mut canvas, &view, arm.reach, unit, label);
    draw_directions(&mut canvas, &view, scene, arm.reach, unit);
    draw_arm(&mut canvas, &view, scene, &arm, unit);
    if with_text {
        draw_header(&mut canvas, scene, w, header, glyph);
        draw_footer(&mut canvas, &view, &arm, (w, h, footer), glyph);
    } else {
        let note = format!("x{}", factor(arm.magnification));
        canvas.text((3.0, h - 9.0), 6.0, &note, INK);
    }
    canvas.into_rgb()
}

/// Draw `scene` as 24 lines of up to 60 characters and two lines of readings, in ASCII.
///
/// `=` link 1, `#` link 2 inside it, `-` link 2 outside, `@` payload, `O` shoulder, `o` tip,
/// `:` reference direction, `.` target direction.
pub fn ansi(scene: &Scene) -> String {
    const COLUMNS: usize = 60;
    const ROWS: usize = 24;
    let arm = Arm::new(scene);
    // A character cell is about twice as high as wide.
    let frame = (1.0, 1.0, COLUMNS as f64 - 1.0, 2.0 * ROWS as f64 - 1.0);
    let view = View::new(scene, arm.reach, frame);
    let mut cells = vec![b' '; COLUMNS * ROWS];
    let mut mark = |point: Point, symbol: u8| {
        let (x, y) = view.pixel(point);
        let (column, row) = (x.floor(), (y / 2.0).floor());
        if (0.0..COLUMNS as f64).contains(&column) && (0.0..ROWS as f64).contains(&row) {
            cells[row as usize * COLUMNS + column as usize] = symbol;
        }
    };
    for (angle, symbol) in [(scene.target_angle, b'.'), (scene.reference_angle, b':')] {
        if angle.is_finite() {
            (1..=60).for_each(|i| mark(polar(arm.reach * f64::from(i) / 60.0, angle), symbol));
        }
    }
    if let Some(shape) = &arm.shape {
        let parts = [
            (&shape.link1, b'='),
            (&shape.inner, b'#'),
            (&shape.outer, b'-'),
        ];
        for (points, symbol) in parts {
            points.iter().for_each(|&point| mark(point, symbol));
        }
        if let Some([a, b, c, d]) = shape.payload {
            for i in 0..=16 {
                for j in 0..=16 {
                    let (s, t) = (f64::from(i) / 16.0, f64::from(j) / 16.0);
                    mark(mix(mix(a, b, s), mix(d, c, s), t), b'@');
                }
            }
        }
        mark(shape.tip, b'o');
    }
    mark((0.0, 0.0), b'O');
    let mut picture = String::with_capacity((COLUMNS + 1) * (ROWS + 2));
    for row in cells.chunks(COLUMNS) {
        picture.push_str(String::from_utf8_lossy(row).trim_end());
        picture.push('\n');
    }
    let readings = readings(scene).map(|(label, value, unit)| format!("{label} {value} {unit}"));
    let (motion, load) = readings.split_at(4);
    let factor = factor(arm.magnification);
    format!(
        "{picture}{}\n{} | drawn x{factor}\n",
        motion.join(" | "),
        load.join(" | ")
    )
}

/// The arm in world coordinates, with deflections magnified.
struct Arm {
    reach: f64,
    magnification: f64,
    reduced: bool,
    shape: Option<Shape>,
}

/// Centre lines of the links, and the payload's corners; absent when a number is not finite.
struct Shape {
    link1: Vec<Point>,
    inner: Vec<Point>,
    outer: Vec<Point>,
    tip: Point,
    tip_angle: f64,
    axis_end: Point,
    payload: Option<[Point; 4]>,
}

impl Arm {
    fn new(scene: &Scene) -> Self {
        let length = |value: f64| finite(value, 0.0).clamp(0.0, 1e6);
        let (l1, l2) = (length(scene.link1_length), length(scene.link2_length));
        let (a, lp) = (length(scene.extension), length(scene.payload_length));
        let reach = l1 + l2.max(a) + lp;
        let reach = if reach > 1e-6 { reach } else { 1.0 };
        let (alpha, beta) = (scene.alpha, scene.beta);
        let turn = finite(scene.turning, 0.0);
        let wanted = finite(scene.magnification, 1.0).clamp(0.0, 1e9);
        let largest = (2.0 * alpha).abs().max((2.0 * (alpha + beta) + turn).abs());
        let limit = MAX_DRAWN_DEFLECTION * reach / largest;
        let reduced = largest.is_finite() && limit < wanted;
        let magnification = if reduced { limit } else { wanted };
        let given = [
            scene.link1_length,
            scene.link2_length,
            scene.extension,
            scene.slew_angle,
            largest,
        ];
        let mut arm = Arm {
            reach,
            magnification,
            reduced,
            shape: None,
        };
        if !given.iter().all(|value| value.is_finite()) {
            return arm;
        }
        let phi = |u: f64| (3.0 - u) * u * u;
        let y1 = |x: f64| magnification * alpha * phi(ratio(x, l1));
        let y2 = |x: f64| {
            magnification * (2.0 * alpha + turn * ratio(x - l1, a) + beta * phi(ratio(x - l1, a)))
        };
        let tip_y = magnification * (2.0 * (alpha + beta) + turn);
        let (sin, cos) = scene.slew_angle.sin_cos();
        let place = |x: f64, y: f64| (x * cos - y * sin, x * sin + y * cos);
        let sweep = |from: f64, to: f64, y: &dyn Fn(f64) -> f64| -> Vec<Point> {
            let at = |i: i32| from + (to - from) * f64::from(i) / 96.0;
            (0..=96).map(|i| place(at(i), y(at(i)))).collect()
        };
        let slope = ratio(magnification * (3.0 * beta + turn), a).atan();
        let tip_angle = scene.slew_angle + slope.clamp(-MAX_DRAWN_SLOPE, MAX_DRAWN_SLOPE);
        let tip = place(l1 + a, tip_y);
        let exists = lp > 0.0 || scene.payload_width > 0.0;
        let payload = exists.then(|| {
            let drawn = |side: f64| side.max(MIN_DRAWN_PAYLOAD * reach);
            let (long, half) = (drawn(lp), drawn(scene.payload_width) / 2.0);
            let (s, c) = tip_angle.sin_cos();
            [(0.0, half), (long, half), (long, -half), (0.0, -half)]
                .map(|(x, y)| (tip.0 + x * c - y * s, tip.1 + x * s + y * c))
        });
        let overlap_start = (l1 - (l2 - a)).clamp(0.0, l1);
        arm.shape = Some(Shape {
            link1: sweep(0.0, l1, &y1),
            inner: sweep(overlap_start, l1, &y1),
            outer: sweep(l1, l1 + a, &y2),
            tip,
            tip_angle,
            axis_end: place(l1 + a + lp, 0.0),
            payload,
        });
        arm
    }
}

/// A fixed camera: pixels per metre and the shoulder's pixel.
struct View {
    scale: f64,
    origin: Point,
    /// The sector of slew angles in the picture, degrees.
    sector: (i32, i32),
}

impl View {
    /// Fit the sector of `scene` into `frame`: left, top, right, bottom in pixels.
    fn new(scene: &Scene, reach: f64, frame: (f64, f64, f64, f64)) -> Self {
        let mirrored = scene.target_angle < 0.0;
        let sector = if mirrored { (-110, 20) } else { (-20, 110) };
        let seen = |angle: f64| {
            let degrees = angle.to_degrees();
            !degrees.is_finite()
                || (f64::from(sector.0) - 1e-6..=f64::from(sector.1) + 1e-6).contains(&degrees)
        };
        let whole = !(seen(scene.target_angle) && seen(scene.slew_angle));
        let sector = if whole { (-180, 180) } else { sector };
        let back = -reach * 20.0_f64.to_radians().sin();
        let (x0, y0, y1) = match sector.0 {
            -180 => (-reach, -reach, reach),
            -110 => (back, -reach, -back),
            _ => (back, back, reach),
        };
        let (left, top, right, bottom) = frame;
        let scale = ((right - left) / (reach - x0))
            .min((bottom - top) / (y1 - y0))
            .max(1e-9);
        let middle = ((left + right) / 2.0, (top + bottom) / 2.0);
        let across = middle.0 - scale * (x0 + reach) / 2.0;
        let origin = (across, middle.1 + scale * (y0 + y1) / 2.0);
        View {
            scale,
            origin,
            sector,
        }
    }

    fn pixel(&self, (x, y): Point) -> Point {
        let (left, top) = self.origin;
        (left + self.scale * x, top - self.scale * y)
    }

    fn pixels(&self, points: &[Point]) -> Vec<Point> {
        points.iter().map(|&point| self.pixel(point)).collect()
    }
}

/// Reach limit with a tick every ten degrees and, with a glyph size, labels every thirty.
fn draw_dial(canvas: &mut Canvas, view: &View, reach: f64, unit: f64, glyph: Option<f64>) {
    let (first, last) = view.sector;
    let rim: Vec<Point> = (first..=last)
        .map(|d| view.pixel(polar(reach, f64::from(d).to_radians())))
        .collect();
    canvas.line(&rim, 1.2 * unit, FAINT, None);
    for degrees in (first + 1..=last).filter(|d| d % 10 == 0) {
        let angle = f64::from(degrees).to_radians();
        let tick = if degrees % 30 == 0 { 10.0 } else { 5.0 } * unit / view.scale;
        let ends = [polar(reach - tick, angle), polar(reach, angle)];
        canvas.line(&view.pixels(&ends), 1.2 * unit, FAINT, None);
        if let Some(glyph) = glyph.filter(|_| degrees % 30 == 0) {
            let (x, y) = view.pixel(polar(reach + 15.0 * unit / view.scale, angle));
            let label = degrees.to_string();
            let x = x - label.len() as f64 * glyph * 0.45;
            canvas.text((x, y - glyph * 0.6), glyph * 0.9, &label, GREY);
        }
    }
}

fn draw_directions(canvas: &mut Canvas, view: &View, scene: &Scene, reach: f64, unit: f64) {
    if scene.target_angle.is_finite() {
        let end = view.pixel(polar(reach, scene.target_angle));
        canvas.line(&[view.origin, end], 1.6 * unit, PURPLE, None);
        let outside = |radius: f64, turn: f64| {
            let (x, y) = polar(radius * unit, scene.target_angle + turn);
            (end.0 + x, end.1 - y)
        };
        let marker = [outside(-2.0, 0.0), outside(8.0, 0.7), outside(8.0, -0.7)];
        canvas.polygon(&marker, PURPLE);
    }
    if scene.reference_angle.is_finite() {
        let ends = [view.origin, view.pixel(polar(reach, scene.reference_angle))];
        canvas.line(&ends, 1.8 * unit, INK, Some([7.0 * unit, 5.0 * unit]));
    }
}

fn draw_arm(canvas: &mut Canvas, view: &View, scene: &Scene, arm: &Arm, unit: f64) {
    let wheel = (9.0 * unit).max(2.5);
    canvas.polygon(&arc(view.origin, 2.6 * wheel, 0.0, TAU), FAINT);
    if let Some(shape) = &arm.shape {
        let axis = [view.origin, view.pixel(shape.axis_end)];
        canvas.line(&axis, 1.2 * unit.max(0.5), GREY, None);
        let thick = (13.0 * unit).max(3.0);
        let thin = 0.5 * thick;
        let link1 = view.pixels(&shape.link1);
        canvas.line(&link1, thick, BLUE, None);
        canvas.line(&link1, 0.66 * thick, [168, 206, 230], None);
        let outer = view.pixels(&shape.outer);
        let (inner, dash) = (view.pixels(&shape.inner), [thin, 0.4 * thin]);
        canvas.line(&inner, thin, [240, 184, 80], Some(dash));
        canvas.line(&outer, thin, ORANGE, None);
        if let Some(payload) = shape.payload {
            let mut corners = view.pixels(&payload);
            canvas.polygon(&corners, GREEN);
            corners.push(corners[0]);
            canvas.line(&corners, 1.4 * unit, [0, 98, 72], None);
        }
        let back = polar(1.2 * wheel, shape.tip_angle);
        let tip = view.pixel(shape.tip);
        let centre = (tip.0 - back.0, tip.1 + back.1);
        let disc = (centre, 0.75 * wheel);
        draw_wheel(canvas, disc, shape.tip_angle, scene.tip_torque, unit);
    }
    let axis = finite(scene.slew_angle, 0.0);
    let disc = (view.origin, 1.25 * wheel);
    draw_wheel(canvas, disc, axis, scene.root_torque, unit);
}

/// A disc with an arc that starts on the axis and turns the way the torque does.
///
/// Full torque turns 300 degrees; the colour repeats the sign.
fn draw_wheel(canvas: &mut Canvas, disc: (Point, f64), axis: f64, fraction: f64, unit: f64) {
    let (centre, radius) = disc;
    let ring = 1.65 * radius;
    let width = (3.6 * unit).max(1.5);
    canvas.line(&arc(centre, ring, 0.0, TAU), width, [226, 230, 234], None);
    canvas.polygon(&arc(centre, radius, 0.0, TAU), INK);
    canvas.polygon(&arc(centre, 0.62 * radius, 0.0, TAU), PAPER);
    canvas.polygon(&arc(centre, 0.25 * radius, 0.0, TAU), INK);
    let fraction = finite(fraction, 0.0).clamp(-1.0, 1.0);
    if fraction.abs() > 1e-3 {
        let turn = fraction * TAU * 300.0 / 360.0;
        let tone = if fraction > 0.0 { VERMILION } else { BLUE };
        canvas.line(&arc(centre, ring, axis, turn), width, tone, None);
        let end = axis + turn;
        let head = fraction.signum() * 1.7 * width / ring;
        let at = |r: f64, angle: f64| arc(centre, r, angle, 0.0)[0];
        let outer = ring + 1.3 * width;
        let inner = ring - 1.3 * width;
        let arrow = [at(inner, end), at(outer, end), at(ring, end + head)];
        canvas.polygon(&arrow, tone);
    }
}

/// Label, value and unit of the numbers beside the picture.
fn readings(scene: &Scene) -> [(&'static str, String, &'static str); 8] {
    let percent = |fraction: f64| number(fraction * 100.0, 0, true);
    let millimetres = |length: f64| number(length * 1e3, 2, true);
    let degrees = |angle: f64| number(angle.to_degrees(), 2, true);
    let (root, tip) = (percent(scene.root_torque), percent(scene.tip_torque));
    [
        ("time", number(scene.time, 2, false), "s"),
        ("slew ends at", number(scene.slew_end_time, 2, false), "s"),
        ("slew angle", degrees(scene.slew_angle), "deg"),
        ("reference", degrees(scene.reference_angle), "deg"),
        ("tip deflection", millimetres(scene.tip_deflection), "mm"),
        ("tip error", millimetres(scene.tip_error), "mm"),
        ("payload", number(scene.payload_mass, 0, false), "kg"),
        ("wheels", format!("{root} / {tip}"), "% root/tip"),
    ]
}

fn draw_header(canvas: &mut Canvas, scene: &Scene, w: f64, height: f64, glyph: f64) {
    canvas.polygon(&[(0.0, 0.0), (w, 0.0), (w, height), (0.0, height)], PANEL);
    canvas.line(&[(0.0, height), (w, height)], 1.0, FAINT, None);
    for (i, (label, value, unit)) in readings(scene).iter().enumerate() {
        let (left, span) = [(1.4 * glyph, 22.0), (w * 0.48, 25.0)][i / 4];
        // The unit of the last row is long.
        let end = left + if i == 7 { 18.0 } else { span } * glyph;
        let y = (0.85 + 1.75 * (i % 4) as f64) * glyph;
        canvas.text((left, y), glyph, label, GREY);
        canvas.text((end - value.len() as f64 * glyph, y), glyph, value, INK);
        canvas.text((end + 0.6 * glyph, y), glyph, unit, GREY);
    }
}

/// Magnification, the meaning of the two direction lines, and a scale bar.
fn draw_footer(canvas: &mut Canvas, view: &View, arm: &Arm, size: (f64, f64, f64), glyph: f64) {
    let (w, h, footer) = size;
    let top = h - footer;
    canvas.polygon(&[(0.0, top), (w, top), (w, h), (0.0, h)], PANEL);
    canvas.line(&[(0.0, top), (w, top)], 1.0, FAINT, None);
    let y = top + (footer - 1.33 * glyph) / 2.0;
    let middle = y + 0.6 * glyph;
    let mut note = format!("deflection x{}", factor(arm.magnification));
    if arm.reduced {
        note.push_str(" (cut)");
    }
    canvas.text((1.4 * glyph, y), glyph, &note, INK);
    let mut x = 26.0 * glyph;
    for (name, tone, dash) in [
        ("reference", INK, Some([0.7 * glyph, 0.5 * glyph])),
        ("target", PURPLE, None),
    ] {
        let sample = [(x, middle), (x + 2.4 * glyph, middle)];
        canvas.line(&sample, 0.18 * glyph, tone, dash);
        canvas.text((x + 3.0 * glyph, y), glyph, name, GREY);
        x += (4.0 + name.len() as f64) * glyph;
    }
    let longest = 8.0 * glyph / view.scale;
    let decade = 10f64.powf(longest.log10().floor());
    let fits = |n: &f64| n * decade <= longest;
    let bar = [5.0, 2.0].into_iter().find(fits).unwrap_or(1.0) * decade;
    let (right, left) = (w - 1.4 * glyph, w - 1.4 * glyph - bar * view.scale);
    let (low, high) = (middle + 0.4 * glyph, middle - 0.4 * glyph);
    canvas.line(
        &[(left, high), (left, low), (right, low), (right, high)],
        0.15 * glyph,
        INK,
        None,
    );
    let label = format!("{bar} m");
    let start = left - (label.len() as f64 + 0.6) * glyph;
    canvas.text((start, y), glyph, &label, INK);
}

fn finite(value: f64, otherwise: f64) -> f64 {
    if value.is_finite() { value } else { otherwise }
}

/// `part / whole`, or zero where there is no whole.
fn ratio(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

fn polar(radius: f64, angle: f64) -> Point {
    (radius * angle.cos(), radius * angle.sin())
}

/// Points in pixels on an arc around `centre`, counter-clockwise for a positive `turn`.
fn arc(centre: Point, radius: f64, from: f64, turn: f64) -> Vec<Point> {
    let at = |i: i32| polar(radius, from + turn * f64::from(i) / 60.0);
    (0..=60)
        .map(at)
        .map(|(x, y)| (centre.0 + x, centre.1 - y))
        .collect()
}

fn mix(a: Point, b: Point, s: f64) -> Point {
    (a.0 + s * (b.0 - a.0), a.1 + s * (b.1 - a.1))
}

/// A number no wider than about nine characters; "n/a" when it is not finite.
fn number(value: f64, decimals: usize, signed: bool) -> String {
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

fn factor(value: f64) -> String {
    number(
        value,
        if value >= 10.0 || value.fract() == 0.0 {
            0
        } else {
            2
        },
        false,
    )
}

#[cfg(test)]
mod tests;
