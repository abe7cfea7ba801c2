//! What stands beside the arm: payload, wheels, reward, curves.

use super::canvas::{Anchor, Canvas, Tone, Type};
use super::font::{self, Weight};
use super::geometry::{Area, Point, rounded_up};
use super::palette::{FAINT, GREY, INK, PAPER, Rgb, STEEL, TROUGH, VERMILION, between};
use super::scene::{Extent, Moment, Payment, Sample, Stage};
use super::text::{millimetres, misreport, number};

/// From here on a wheel is at its limit.
pub(super) const SATURATED: f64 = 0.999;

/// Texts of one picture, by what they are for.
#[derive(Clone, Copy)]
pub(super) struct Types {
    /// Pixels of a unit: a picture of 640 by 480 has 1.
    pub(super) unit: f64,
}

impl Types {
    fn of(self, size: f64, weight: Weight, colour: Rgb) -> Type {
        Type {
            size: size * self.unit,
            weight,
            colour,
        }
    }

    pub(super) fn title(self) -> Type {
        self.of(14.5, Weight::Bold, INK)
    }

    pub(super) fn heading(self) -> Type {
        self.of(11.5, Weight::Bold, INK)
    }

    pub(super) fn value(self) -> Type {
        self.of(11.5, Weight::Regular, INK)
    }

    pub(super) fn label(self) -> Type {
        self.of(11.5, Weight::Regular, GREY)
    }

    pub(super) fn tick(self) -> Type {
        self.of(10.0, Weight::Regular, GREY)
    }

    pub(super) fn alarm(self) -> Type {
        self.of(11.5, Weight::Bold, VERMILION)
    }
}

/// Height of a row of text in a panel, units.
pub(super) const ROW: f64 = 16.5;
/// Room between two groups of rows, units.
const GAP: f64 = 9.0;

/// Whether a value is at its limit.
pub(super) fn is_saturated(value: f64, limit: f64) -> bool {
    value.abs() >= SATURATED * limit
}

/// Rows of text and gauges, from the top of an area.
struct Rows<'a> {
    canvas: &'a mut Canvas,
    types: Types,
    area: Area,
    /// Top of the next row.
    top: f64,
}

impl Rows<'_> {
    fn baseline(&self) -> f64 {
        self.top + 12.0 * self.types.unit
    }

    fn next(&mut self) {
        self.top += ROW * self.types.unit;
    }

    fn gap(&mut self) {
        self.top += GAP * self.types.unit;
    }

    /// A label and what it says, to the right.
    fn row(&mut self, label: Type, name: &str, kind: Type, value: &str) {
        let y = self.baseline();
        self.canvas
            .text((self.area.left, y), Anchor::Left, label, name);
        self.canvas
            .text((self.area.right, y), Anchor::Right, kind, value);
        self.next();
    }

    /// A gauge from the left or, with `both`, from its middle; without a limit the value alone.
    fn gauge(
        &mut self,
        label: Type,
        name: &str,
        text: &str,
        share: Option<f64>,
        both: bool,
        tone: Rgb,
    ) {
        let (types, y) = (self.types, self.baseline());
        let unit = types.unit;
        let full = share.is_some_and(|share| share.abs() >= SATURATED && both);
        let kind = if full { types.alarm() } else { types.value() };
        self.canvas
            .text((self.area.left, y), Anchor::Left, label, name);
        // not by colour alone
        let text = if full {
            format!("limit {text}")
        } else {
            text.to_owned()
        };
        self.canvas
            .text((self.area.right, y), Anchor::Right, kind, &text);
        if let Some(share) = share {
            let left = self.area.left + 68.0 * unit;
            let right = self.area.right - 98.0 * unit;
            let middle = self.baseline() - 4.0 * unit;
            let half = 3.5 * unit;
            let place = Area::new(left, middle - half, right, middle + half);
            self.canvas.rectangle(place, TROUGH);
            let share = if share.is_finite() { share } else { 0.0 };
            let zero = if both { (left + right) / 2.0 } else { left };
            let end = zero + (right - zero) * share.clamp(-1.0, 1.0);
            let bar = Area::new(zero.min(end), place.top, zero.max(end), place.bottom);
            self.canvas
                .rectangle(bar, if full { VERMILION } else { tone });
            if both {
                let mark = Area::new(
                    zero - 0.5 * unit,
                    place.top - 2.0 * unit,
                    zero + 0.5 * unit,
                    place.bottom + 2.0 * unit,
                );
                self.canvas.rectangle(mark, GREY);
            }
        }
        self.next();
    }
}

/// Payload, wheels and reward; returns where they end.
pub(super) fn draw_state(
    canvas: &mut Canvas,
    types: Types,
    area: Area,
    stage: &Stage,
    moment: &Moment,
    extent: &Extent,
    colour: Rgb,
) -> f64 {
    let mut rows = Rows {
        canvas,
        types,
        area,
        top: area.top,
    };
    let mass = |mass: f64| format!("{} kg", number(mass, 1, false));
    rows.row(
        types.heading(),
        "Payload",
        types.value(),
        &mass(stage.payload_mass),
    );
    let told = misreport(stage.payload_mass, stage.reported_mass);
    rows.row(
        types.label(),
        "reported",
        types.value(),
        &format!("{} ({told})", mass(stage.reported_mass)),
    );
    rows.gap();
    for (place, name) in ["Root wheel", "Tip wheel"].into_iter().enumerate() {
        let torque = moment.torques[1 + place];
        let limit = stage.torque_limits[1 + place];
        let momentum = moment.momenta[place];
        let most = stage.momentum_limits[place];
        let decimals = if limit < 100.0 { 2 } else { 1 };
        let text = format!("{} N m", number(torque, decimals, true));
        rows.gauge(
            types.heading(),
            name,
            &text,
            Some(torque / limit),
            true,
            colour,
        );
        let text = format!("{} N m s", number(momentum, 1, true));
        let share = (most < f64::INFINITY).then_some(momentum / most);
        rows.gauge(types.label(), "momentum", &text, share, true, colour);
    }
    let (torque, limit) = (moment.torques[0], stage.torque_limits[0]);
    let text = format!("{} N m", number(torque, 0, true));
    let share = Some(torque / limit);
    rows.gauge(types.heading(), "Slew motor", &text, share, true, STEEL);
    if let Some(Payment { terms, sum }) = moment.payment {
        rows.gap();
        let text = format!("return {}", number(sum, 3, false));
        rows.row(types.heading(), "Reward", types.value(), &text);
        for (name, term) in ["vibration", "slew error", "effort"].into_iter().zip(terms) {
            let share = if extent.payment > 0.0 {
                term.abs() / extent.payment
            } else {
                0.0
            };
            let text = number(term, 5, false);
            rows.gauge(types.label(), name, &text, Some(share), false, STEEL);
        }
    }
    rows.top
}

/// Rows that [`draw_state`] takes, units.
pub(super) fn state_height(paid: bool) -> f64 {
    let (rows, gaps) = if paid { (11.0, 2.0) } else { (7.0, 1.0) };
    rows * ROW + gaps * GAP
}

/// One curve over the time of the manoeuvre.
pub(super) struct Chart {
    /// With title and labels.
    pub(super) area: Area,
    /// Whether the axis of time has numbers.
    pub(super) dated: bool,
    pub(super) name: &'static str,
    /// Whether the end of the slew is named.
    pub(super) explained: bool,
    /// Smallest and largest value that it must show, m.
    pub(super) range: [f64; 2],
    pub(super) horizon: f64,
    pub(super) slew_end: f64,
}

impl Chart {
    /// Where the curve is.
    fn plot(&self, types: Types) -> Area {
        let unit = types.unit;
        Area::new(
            self.area.left + 40.0 * unit,
            self.area.top + 18.0 * unit,
            self.area.right - 4.0 * unit,
            self.area.bottom - if self.dated { 18.0 } else { 5.0 } * unit,
        )
    }

    /// Lowest and highest value of the axis, m.
    fn axis(&self) -> [f64; 2] {
        let [low, high] = self.range;
        // at least so much that noise of micrometres does not fill the picture
        let most = rounded_up(high.max(-low).max(1e-4));
        let side = |value: f64| rounded_up(value).max(0.2 * most);
        [-side(-low), side(high)]
    }

    /// From time (s) and value (m) to pixels.
    fn places(&self, plot: Area) -> impl Fn(f64, f64) -> Point {
        let [low, high] = self.axis();
        let (across, down) = (plot.width() / self.horizon, plot.height() / (high - low));
        move |time, value| {
            (
                plot.left + across * time,
                plot.bottom - down * (value - low),
            )
        }
    }

    /// Axes, grid and labels: what stays.
    pub(super) fn draw_frame(&self, canvas: &mut Canvas, types: Types) {
        let (unit, plot) = (types.unit, self.plot(types));
        let thin = 1.0_f64.max(unit.round());
        let place = self.places(plot);
        canvas.rectangle(plot, PAPER);
        canvas.text(
            (self.area.left, self.area.top + 12.0 * unit),
            Anchor::Left,
            types.heading(),
            self.name,
        );
        let step = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0]
            .into_iter()
            .find(|step| plot.width() * step / self.horizon > 34.0 * unit)
            .unwrap_or(self.horizon);
        let count = (self.horizon / step + 1e-9).floor() as i32;
        for i in 0..=count.min(200) {
            let time = f64::from(i) * step;
            let (x, _) = place(time, 0.0);
            let x = x.round();
            canvas.rectangle(
                Area::new(x, plot.top, x + thin, plot.bottom),
                between(PAPER, FAINT, 0.6),
            );
            if self.dated {
                let text = if i == count {
                    format!("{} s", number(time, 0, false))
                } else {
                    number(time, 0, false)
                };
                let y = plot.bottom + 12.0 * unit;
                let anchor = if i == count {
                    Anchor::Right
                } else {
                    Anchor::Middle
                };
                let shift = if i == count { 4.0 * unit } else { 0.0 };
                canvas.text((x + shift, y), anchor, types.tick(), &text);
            }
        }
        let [low, high] = self.axis();
        for value in [low, 0.0, high] {
            let (_, y) = place(0.0, value);
            let y = y.round();
            let tone = if value == 0.0 { GREY } else { FAINT };
            canvas.rectangle(Area::new(plot.left, y, plot.right, y + thin), tone);
            let base = match value {
                v if v == low => y,
                v if v == high => y + 7.0 * unit,
                _ => y + 3.5 * unit,
            };
            // labels that would touch
            let close =
                (value == low && -low < 0.35 * high) || (value == high && high < -0.35 * low);
            if !close {
                let metres = high.max(-low) >= 10.0;
                let text = if metres {
                    number(value, 0, false)
                } else {
                    let decimals = usize::from(high.max(-low) < 2e-3);
                    number(value * 1e3, decimals, false)
                };
                canvas.text(
                    (plot.left - 4.0 * unit, base),
                    Anchor::Right,
                    types.tick(),
                    &text,
                );
            }
        }
        if self.slew_end > 0.0 && self.slew_end < self.horizon {
            let (x, _) = place(self.slew_end, 0.0);
            let line = [(x, plot.top), (x, plot.bottom)];
            let dash = [3.0 * unit, 3.0 * unit];
            canvas.dashed(&line, thin, GREY, Some(dash));
            let text = "slew ends";
            let length = font::length(text, Weight::Regular, types.tick().size);
            if self.explained && x + length + 6.0 * unit < plot.right {
                let at = (x + 4.0 * unit, plot.top + 9.0 * unit);
                canvas.text(at, Anchor::Left, types.tick(), text);
            }
        }
    }

    /// The curve and the value that it has reached (m).
    pub(super) fn draw_curve(
        &self,
        canvas: &mut Canvas,
        types: Types,
        samples: &[Sample],
        value: impl Fn(&Sample) -> f32,
        colour: Rgb,
    ) {
        let (unit, plot) = (types.unit, self.plot(types));
        let place = self.places(plot);
        let points: Vec<Point> = samples
            .iter()
            .map(|sample| place(f64::from(sample.time), f64::from(value(sample))))
            .collect();
        canvas.curve(&points, 1.7 * unit, colour);
        if let (Some(&end), Some(sample)) = (points.last(), samples.last()) {
            canvas.disc(end, 3.0 * unit, colour);
            let text = millimetres(f64::from(value(sample)));
            let at = (plot.right, self.area.top + 12.0 * unit);
            canvas.text(at, Anchor::Right, types.value(), &text);
        }
    }
}

/// A text on a coloured ground, its middle at a point.
pub(super) fn draw_badge(canvas: &mut Canvas, types: Types, at: Point, text: &str) {
    let kind = Type {
        colour: PAPER,
        ..types.heading()
    };
    let length = font::length(text, kind.weight, kind.size);
    let (across, down) = (length / 2.0 + 10.0 * types.unit, 11.0 * types.unit);
    let area = Area::new(at.0 - across, at.1 - down, at.0 + across, at.1 + down);
    canvas.pill(area, Tone(VERMILION, 1.0));
    canvas.text((at.0, at.1 + 4.0 * types.unit), Anchor::Middle, kind, text);
}
