//! A whole picture: the arm, and beside it what there is room for.

use std::f64::consts::TAU;

use super::arm::{Arm, longest_reach};
use super::canvas::{Anchor, Canvas, Tone, Type};
use super::font;
use super::geometry::{Area, Point, arc, finite, polar};
use super::palette::{FAINT, FIELD, GREY, INK, PANEL, PAPER, PURPLE, STEEL, VERMILION, between};
use super::panels::{Chart, Types, draw_badge, draw_state, is_saturated, state_height};
use super::scene::{Ending, Extent, Look, Moment, Sample, Stage};
use super::text::{factor, millimetres, number};
use super::view::View;

/// Where things are.
struct Layout {
    types: Types,
    /// Title and time; none in the smallest pictures.
    header: Option<Area>,
    scene: Area,
    /// Below the scene.
    legend: Option<Area>,
    state: Option<Area>,
    charts: Option<[Area; 2]>,
}

impl Layout {
    fn new(look: &Look, paid: bool) -> Self {
        let (w, h) = (f64::from(look.width), f64::from(look.height));
        let wide = w / h >= 1.45;
        let unit = if wide {
            (w / 800.0).min(h / 450.0)
        } else {
            (w / 640.0).min(h / 480.0)
        };
        let tall = (w / 300.0).min(h / 360.0);
        if w / h < 1.1 && unit < 1.0 && tall >= 0.8 {
            return Self::tall(w, h, tall.min(w / 340.0).max(0.8));
        }
        if unit < 0.72 {
            return Self::small(w, h);
        }
        let header = 38.0 * unit;
        let legend = 26.0 * unit;
        let mut layout = Self {
            types: Types { unit },
            header: Some(Area::new(0.0, 0.0, w, header)),
            scene: Area::new(0.0, header, w, h),
            legend: None,
            state: None,
            charts: None,
        };
        let column = if wide { 272.0 } else { 222.0 } * unit;
        let edge = w - column;
        let pad = 12.0 * unit;
        if wide {
            layout.scene = Area::new(0.0, header, edge, h - legend);
            layout.legend = Some(Area::new(0.0, h - legend, edge, h));
            let below = header + pad * 0.7 + state_height(paid) * unit + pad * 0.5;
            let middle = (below + h - 13.0 * unit) / 2.0;
            layout.state = Some(Area::new(edge + pad, header + pad * 0.7, w - pad, below));
            layout.charts = Some([
                Area::new(edge + pad, below, w - pad, middle),
                Area::new(edge + pad, middle, w - pad, h - 2.0 * unit),
            ]);
        } else {
            let charts = 128.0 * unit + (h - 480.0 * unit) * 0.3;
            let bottom = h - charts;
            layout.scene = Area::new(0.0, header, edge, bottom - legend);
            layout.legend = Some(Area::new(0.0, bottom - legend, edge, bottom));
            layout.state = Some(Area::new(edge + pad, header + pad * 0.7, w - pad, bottom));
            let middle = w / 2.0;
            layout.charts = Some([
                Area::new(pad, bottom + 7.0 * unit, middle - pad * 0.7, h - 2.0 * unit),
                Area::new(
                    middle + pad * 0.7,
                    bottom + 7.0 * unit,
                    w - pad,
                    h - 2.0 * unit,
                ),
            ]);
        }
        layout
    }

    /// Title, arm, and the curves below: for pictures beside each other.
    fn tall(w: f64, h: f64, unit: f64) -> Self {
        let header = 28.0 * unit;
        let chart = (0.21 * h).max(72.0 * unit);
        let pad = 10.0 * unit;
        let bottom = h - 2.0 * chart - 4.0 * unit;
        Self {
            types: Types { unit },
            header: Some(Area::new(0.0, 0.0, w, header)),
            scene: Area::new(0.0, header, w, bottom),
            legend: None,
            state: None,
            charts: Some([
                Area::new(pad, bottom + 4.0 * unit, w - pad, bottom + chart),
                Area::new(pad, bottom + chart, w - pad, h - 2.0 * unit),
            ]),
        }
    }

    /// Title, arm, and one line below.
    fn small(w: f64, h: f64) -> Self {
        let unit = (w / 300.0).min(h / 210.0).min(1.0);
        let mut layout = Self {
            types: Types {
                unit: unit.max(0.8),
            },
            header: None,
            scene: Area::new(0.0, 0.0, w, h),
            legend: None,
            state: None,
            charts: None,
        };
        if unit >= 0.5 {
            let unit = layout.types.unit;
            layout.header = Some(Area::new(0.0, 0.0, w, 24.0 * unit));
            layout.scene = Area::new(0.0, 24.0 * unit, w, h - 22.0 * unit);
            layout.legend = Some(Area::new(0.0, h - 22.0 * unit, w, h));
        }
        layout
    }

    fn is_small(&self) -> bool {
        self.state.is_none()
    }
}

/// What one picture shows.
pub(super) struct Frame<'a> {
    pub(super) look: &'a Look,
    pub(super) stage: &'a Stage,
    pub(super) moment: &'a Moment,
    /// What was before, the oldest first.
    pub(super) past: &'a [Sample],
    pub(super) extent: &'a Extent,
    pub(super) ending: Ending,
}

/// What does not move, kept from picture to picture.
pub(super) struct Backdrop {
    look: Look,
    stage: Stage,
    view: View,
    /// Ranges of the charts' axes follow from it.
    extent: Extent,
    canvas: Canvas,
    /// Where the next picture is drawn.
    sheet: Canvas,
}

impl Backdrop {
    /// Whether it was made for pictures that look so.
    pub(super) fn is_of(&self, look: &Look) -> bool {
        self.look == *look
    }
}

impl Frame<'_> {
    /// The picture as rows of red, green and blue; `kept` is what the last one has left.
    pub(super) fn draw(&self, kept: &mut Option<Backdrop>) -> Vec<u8> {
        let look = self.look;
        let layout = Layout::new(look, self.moment.payment.is_some());
        let margin = if layout.is_small() { 4.0 } else { 10.0 } * layout.types.unit;
        let view = View::new(self.stage, self.extent, layout.scene.within(margin, margin));
        let extent = self.rounded_extent();
        let usable = kept.as_ref().is_some_and(|backdrop| {
            backdrop.look == *look
                && backdrop.view == view
                && backdrop.extent == extent
                && backdrop.stage == *self.stage
        });
        if !usable {
            let Some(canvas) = Canvas::new(look.width, look.height, PAPER) else {
                return vec![255; look.width as usize * look.height as usize * 3];
            };
            let mut backdrop = Backdrop {
                look: look.clone(),
                stage: self.stage.clone(),
                view,
                extent,
                sheet: canvas.clone(),
                canvas,
            };
            self.draw_backdrop(&mut backdrop.canvas, &layout, &view);
            *kept = Some(backdrop);
        }
        let Some(backdrop) = kept else {
            return Vec::new();
        };
        backdrop.sheet.copy(&backdrop.canvas);
        self.draw_moving(&mut backdrop.sheet, &layout, &view);
        backdrop.sheet.to_rgb()
    }

    /// The extent as far as the axes show it.
    fn rounded_extent(&self) -> Extent {
        let round = |range: [f64; 2]| range.map(|v| super::geometry::rounded_up(v.abs()));
        Extent {
            error: round(self.extent.error),
            deflection: round(self.extent.deflection),
            slew: [0.0; 2],
            payment: 0.0,
        }
    }

    fn charts(&self, layout: &Layout) -> Option<[Chart; 2]> {
        let chart = |area, name, explained, range| Chart {
            area,
            explained,
            dated: !explained || layout.state.is_some(),
            name,
            range,
            horizon: self.stage.horizon.max(1e-6),
            slew_end: self.stage.slew_end,
        };
        layout.charts.map(|[first, second]| {
            [
                chart(first, "Tip error (mm)", true, self.extent.error),
                chart(second, "Tip deflection (mm)", false, self.extent.deflection),
            ]
        })
    }

    fn draw_backdrop(&self, canvas: &mut Canvas, layout: &Layout, view: &View) {
        let (w, h) = (f64::from(self.look.width), f64::from(self.look.height));
        let types = layout.types;
        self.draw_field(canvas, layout, view);
        let thin = types.unit.round().max(1.0);
        if let Some(area) = layout.header {
            canvas.rectangle(area, PANEL);
            canvas.rectangle(Area::new(0.0, area.bottom - thin, w, area.bottom), FAINT);
            let small = layout.is_small();
            let (left, size) = if small { (6.0, 8.0) } else { (14.0, 11.0) };
            let (left, size) = (left * types.unit, size * types.unit);
            let middle = area.height() / 2.0;
            let swatch = Area::new(left, middle - size / 2.0, left + size, middle + size / 2.0);
            canvas.rectangle(swatch, self.look.colour);
            let title = match self.look.title.as_str() {
                "" => "Deployable robotic manipulator",
                title => title,
            };
            let kind = if small {
                types.heading()
            } else {
                types.title()
            };
            let room = w - left - size - if small { 70.0 } else { 160.0 } * types.unit;
            let title = shortened(title, kind, room);
            let at = (left + 1.6 * size, middle + 0.36 * kind.size);
            canvas.text(at, Anchor::Left, kind, &title);
        }
        if layout.is_small()
            && let Some(area) = layout.legend
        {
            canvas.rectangle(area, PANEL);
            canvas.rectangle(Area::new(0.0, area.top, w, area.top + thin), FAINT);
        }
        if let Some(area) = layout.state {
            let left = area.left - 12.0 * types.unit;
            let top = layout.header.map_or(0.0, |header| header.bottom);
            canvas.rectangle(Area::new(left, top, w, h), PANEL);
            canvas.rectangle(Area::new(left, top, left + thin, h), FAINT);
        }
        if let Some([first, second]) = layout.charts
            && (first.top == second.top || layout.is_small())
        {
            let top = first.top - 6.0 * types.unit;
            canvas.rectangle(Area::new(0.0, top, w, h), PANEL);
            canvas.rectangle(Area::new(0.0, top, w, top + thin), FAINT);
        }
        if let Some(charts) = self.charts(layout) {
            charts
                .iter()
                .for_each(|chart| chart.draw_frame(canvas, types));
        }
        if let Some(area) = layout.legend.filter(|_| !layout.is_small()) {
            self.draw_legend(canvas, types, area, view);
        }
    }

    /// The sector that the arm sweeps, with its angles, and the target.
    fn draw_field(&self, canvas: &mut Canvas, layout: &Layout, view: &View) {
        let unit = layout.types.unit;
        let reach = longest_reach(self.stage);
        let rim = reach * view.scale;
        let (from, to) = view.sector;
        let mut field = vec![view.origin];
        field.extend(arc(view.origin, rim, from, to - from));
        canvas.polygon(&field, FIELD);
        let thin = unit.max(1.0);
        for radius in 1..=40 {
            let radius = f64::from(radius) * 5.0;
            if radius < 0.97 * reach {
                let line = arc(view.origin, radius * view.scale, from, to - from);
                canvas.line(&line, thin, FAINT);
            }
        }
        canvas.line(&arc(view.origin, rim, from, to - from), thin, FAINT);
        let small = layout.is_small();
        let span = (to - from).to_degrees();
        let step = if span > 150.0 { 30 } else { 10 };
        let first = (from.to_degrees() / f64::from(step)).ceil() as i32;
        let last = (to.to_degrees() / f64::from(step)).floor() as i32;
        let target = self.stage.target_angle.to_degrees();
        for i in first..=last {
            let degrees = f64::from(i * step);
            let angle = degrees.to_radians();
            let at = |radius: f64| view.pixel(polar(radius, angle));
            canvas.line(&[at(0.12 * reach), at(reach)], thin, Tone(FAINT, 0.55));
            if !small && (degrees - target).abs() > 0.6 * f64::from(step) {
                let (x, y) = view.pixel(polar(reach - 11.0 * unit / view.scale, angle + 0.022));
                let text = format!("{}°", number(degrees, 0, false));
                canvas.text(
                    (x, y + 3.0 * unit),
                    Anchor::Middle,
                    layout.types.tick(),
                    &text,
                );
            }
        }
        if self.stage.target_angle.is_finite() {
            let angle = self.stage.target_angle;
            let at = |radius: f64| view.pixel(polar(radius, angle));
            let ends = [at(0.12 * reach), at(reach)];
            canvas.dashed(&ends, 1.6 * unit, PURPLE, Some([8.0 * unit, 4.0 * unit]));
            if !small {
                let side = if angle < 0.0 { -1.0 } else { 1.0 };
                let turn = angle + side * 12.0 * unit / (0.8 * rim);
                let (x, y) = view.pixel(polar(0.8 * reach, turn));
                let text = format!("target {}°", number(target, 1, false));
                let kind = Type {
                    colour: between(PURPLE, INK, 0.35),
                    ..layout.types.tick()
                };
                canvas.text((x - 4.0 * unit, y), Anchor::Right, kind, &text);
            }
        }
    }

    /// What lines mean, and the scale.
    fn draw_legend(&self, canvas: &mut Canvas, types: Types, area: Area, view: &View) {
        let unit = types.unit;
        let y = area.bottom - 9.0 * unit;
        let middle = y - 4.0 * unit;
        let kind = types.tick();
        let mut x = area.left + 14.0 * unit;
        let swatch = Area::new(x, middle - 3.5 * unit, x + 20.0 * unit, middle + 3.5 * unit);
        let outline = [
            (swatch.left, swatch.top),
            (swatch.right, swatch.top),
            (swatch.right, swatch.bottom),
            (swatch.left, swatch.bottom),
            (swatch.left, swatch.top),
        ];
        canvas.polygon(&outline, Tone(INK, 0.07));
        canvas.dashed(
            &outline,
            unit.max(1.0),
            Tone(INK, 0.55),
            Some([3.0 * unit, 2.0 * unit]),
        );
        x = canvas.text((x + 25.0 * unit, y), Anchor::Left, kind, "reference, rigid") + 12.0 * unit;
        canvas.line(
            &[(x, middle), (x + 20.0 * unit, middle)],
            2.0 * unit,
            Tone(self.look.colour, 0.6),
        );
        x = canvas.text((x + 25.0 * unit, y), Anchor::Left, kind, "trail of the tip") + 12.0 * unit;
        if self.stage.reported_mass > 0.0 {
            let centre = (x + 6.0 * unit, middle);
            let ring = arc(centre, 5.5 * unit, 0.0, TAU);
            canvas.dashed(&ring, 1.2 * unit, INK, Some([2.5 * unit, 2.0 * unit]));
            canvas.text(
                (x + 16.0 * unit, y),
                Anchor::Left,
                kind,
                "reported mass (area)",
            );
        }
        let bar = [10.0, 5.0, 2.0, 1.0]
            .into_iter()
            .find(|length| length * view.scale < 90.0 * unit)
            .unwrap_or(1.0);
        // above the legend, where the arm is not
        let right = area.right - 12.0 * unit;
        let left = right - bar * view.scale;
        let base = area.top - 2.0 * unit;
        let ends = [
            (left, base - 5.0 * unit),
            (left, base),
            (right, base),
            (right, base - 5.0 * unit),
        ];
        canvas.line(&ends, 1.2 * unit, GREY);
        let label = format!("{} m", number(bar, 0, false));
        canvas.text(
            ((left + right) / 2.0, base - 5.0 * unit),
            Anchor::Middle,
            kind,
            &label,
        );
    }

    fn draw_moving(&self, canvas: &mut Canvas, layout: &Layout, view: &View) {
        let arm = Arm::bent(self.stage, self.moment);
        self.draw_arm(canvas, layout, view, arm.as_ref());
        let types = layout.types;
        let moment = self.moment;
        if let Some(area) = layout.header {
            let middle = area.height() / 2.0;
            let small = layout.is_small();
            let kind = if small { types.value() } else { types.title() };
            let right = area.right - if small { 6.0 } else { 14.0 } * types.unit;
            let y = middle + 0.36 * kind.size;
            if small {
                let time = format!("{} s", number(moment.time, 2, false));
                canvas.text((right, y), Anchor::Right, kind, &time);
            } else {
                let rest = format!(" / {} s", number(self.stage.horizon, 0, false));
                let label = Type {
                    size: kind.size,
                    ..types.label()
                };
                let length = font::length(&rest, label.weight, label.size);
                canvas.text((right, y), Anchor::Right, label, &rest);
                let time = number(moment.time, 2, false);
                canvas.text((right - length, y), Anchor::Right, kind, &time);
            }
        }
        let note = arm.as_ref().map(|arm| {
            let cut = if arm.reduced { ", cut" } else { "" };
            format!("deflection drawn ×{}{cut}", factor(arm.magnification))
        });
        if layout.is_small() {
            self.draw_small(canvas, layout, arm.as_ref());
        } else {
            let unit = types.unit;
            let area = layout.scene;
            // the corner that the arm does not reach
            let up = self.stage.target_angle >= 0.0;
            let (top, down) = if up {
                (area.top + 18.0 * unit, ROW_BELOW * unit)
            } else {
                (area.bottom - 40.0 * unit, ROW_BELOW * unit)
            };
            let left = area.left + 14.0 * unit;
            if let Some(note) = note {
                canvas.text((left, top), Anchor::Left, types.heading(), &note);
            }
            let angle = |radians: f64| number(radians.to_degrees(), 2, true);
            let text = format!("slew angle {}°", angle(moment.slew_angle));
            canvas.text((left, top + down), Anchor::Left, types.label(), &text);
            let text = format!(
                "slew error {}°",
                angle(moment.slew_angle - moment.reference_angle)
            );
            canvas.text((left, top + 2.0 * down), Anchor::Left, types.label(), &text);
        }
        if let Some(area) = layout.state {
            let colour = self.look.colour;
            draw_state(canvas, types, area, self.stage, moment, self.extent, colour);
        }
        if let Some(charts) = self.charts(layout) {
            let now = moment.sample(self.stage);
            let mut samples = self.past.to_vec();
            if samples.last().is_none_or(|last| last.time < now.time) {
                samples.push(now);
            }
            let [error, deflection] = &charts;
            let colour = self.look.colour;
            error.draw_curve(canvas, types, &samples, |sample| sample.error, colour);
            deflection.draw_curve(canvas, types, &samples, |sample| sample.deflection, colour);
        }
        self.draw_ending(canvas, layout);
    }

    /// What a small picture says, below the arm.
    fn draw_small(&self, canvas: &mut Canvas, layout: &Layout, arm: Option<&Arm>) {
        let types = layout.types;
        let drawn = arm.map_or_else(String::new, |arm| format!("×{}", factor(arm.magnification)));
        if layout.charts.is_some() {
            let unit = types.unit;
            let (left, top) = (10.0 * unit, layout.scene.top + 16.0 * unit);
            let text = format!("deflection drawn {drawn}");
            canvas.text((left, top), Anchor::Left, types.value(), &text);
            let [truth, told] = [self.stage.payload_mass, self.stage.reported_mass];
            let text = format!("payload {} kg", number(truth, 0, false));
            canvas.text(
                (left, top + 15.0 * unit),
                Anchor::Left,
                types.label(),
                &text,
            );
            let text = format!("reported {} kg", number(told, 0, false));
            canvas.text(
                (left, top + 30.0 * unit),
                Anchor::Left,
                types.label(),
                &text,
            );
            return;
        }
        let Some(area) = layout.legend else {
            let kind = Type {
                size: 9.0,
                ..types.tick()
            };
            let at = (3.0, layout.scene.bottom - 3.0);
            canvas.text(at, Anchor::Left, kind, &drawn);
            return;
        };
        let y = area.bottom - 7.0 * types.unit;
        let (left, right) = (area.left + 6.0 * types.unit, area.right - 6.0 * types.unit);
        let error = format!(
            "tip error {}",
            millimetres(self.moment.tip_error(self.stage))
        );
        canvas.text((left, y), Anchor::Left, types.value(), &error);
        let text = format!("{} kg  {drawn}", number(self.stage.payload_mass, 0, false));
        if area.width() > 230.0 * types.unit {
            canvas.text((right, y), Anchor::Right, types.label(), &text);
        }
    }

    fn draw_ending(&self, canvas: &mut Canvas, layout: &Layout) {
        let time = |seconds: f64| number(seconds, 2, false);
        let (text, short) = match self.ending {
            Ending::None => return,
            Ending::Diverged(at) => (
                format!("DIVERGED at {} s: the last possible picture", time(at)),
                "DIVERGED",
            ),
            Ending::Limit(at) => (
                format!(
                    "ENDED at {} s: a limit of the structure was reached",
                    time(at)
                ),
                "ENDED AT A LIMIT",
            ),
        };
        let area = layout.scene;
        let at = (
            (area.left + area.right) / 2.0,
            area.bottom - 0.16 * area.height(),
        );
        let types = layout.types;
        if layout.header.is_none() {
            canvas.rectangle(
                Area::new(0.0, area.bottom - 3.0, area.right, area.bottom),
                VERMILION,
            );
            return;
        }
        let text = if layout.is_small() { short } else { &text };
        draw_badge(canvas, types, at, text);
    }

    fn draw_arm(&self, canvas: &mut Canvas, layout: &Layout, view: &View, arm: Option<&Arm>) {
        let unit = layout.types.unit;
        let small = layout.is_small();
        // lines of a pixel are drawn the fast way
        let thin = if unit < 1.25 { 1.0 } else { unit };
        let reach = longest_reach(self.stage);
        let colour = self.look.colour;
        let dark = between(colour, INK, 0.45);
        if let Some(ghost) = Arm::reference(self.stage, self.moment) {
            let [one, _, two] = ghost.bodies(self.stage, 0.0);
            let dash = Some([4.0 * unit, 3.0 * unit]);
            for body in [one, two] {
                let mut outline = view.pixels(&body);
                canvas.polygon(&outline, Tone(INK, 0.07));
                outline.push(outline[0]);
                canvas.dashed(&outline, thin, Tone(INK, 0.55), dash);
            }
        }
        self.draw_trail(canvas, layout, view, arm);
        let hub = 0.07 * reach * view.scale;
        canvas.disc(view.origin, hub, between(PAPER, STEEL, 0.25));
        if let Some(arm) = arm {
            let edge = if small { 1.0 } else { 1.6 * thin } / view.scale;
            let [one, inner, outer] = arm.bodies(self.stage, 0.0);
            let [edge_one, ..] = arm.bodies(self.stage, edge);
            let [.., edge_outer] = arm.bodies(self.stage, 0.6 * edge);
            canvas.polygon(&view.pixels(&edge_one), STEEL);
            canvas.polygon(&view.pixels(&one), between(PAPER, STEEL, 0.22));
            canvas.polygon(&view.pixels(&inner), between(PAPER, colour, 0.45));
            if !small {
                canvas.line(
                    &view.pixels(&arm.lattice(self.stage)),
                    thin,
                    Tone(STEEL, 0.75),
                );
            }
            canvas.polygon(&view.pixels(&edge_outer), dark);
            canvas.polygon(&view.pixels(&outer), colour);
            canvas.polygon(&view.pixels(&arm.collar(self.stage)), STEEL);
            let load = arm.load;
            let centre = view.pixel(load.centre);
            if let Some(radius) = load.radius {
                let radius = radius * view.scale;
                canvas.disc(centre, radius, between(STEEL, INK, 0.4));
                canvas.disc(centre, radius - 1.6 * thin, between(PAPER, STEEL, 0.55));
            }
            if let Some(radius) = load.reported {
                let ring = arc(centre, radius * view.scale, 0.0, TAU);
                let dash = Some([4.0 * unit, 3.0 * unit]);
                canvas.dashed(&ring, 1.3 * thin, INK, dash);
            }
            let radius = 0.026 * reach * view.scale;
            let back = polar(1.25 * radius / view.scale, arm.tip_angle);
            let middle = view.pixel((arm.tip.0 - back.0, arm.tip.1 - back.1));
            self.draw_wheel(canvas, middle, radius, arm.tip_angle, 1, unit);
        }
        let axis = finite(self.moment.slew_angle, 0.0);
        self.draw_wheel(
            canvas,
            view.origin,
            0.05 * reach * view.scale,
            axis,
            0,
            unit,
        );
    }

    /// Where the tip has been, as it was drawn: all of it faintly, the last second strongly.
    fn draw_trail(&self, canvas: &mut Canvas, layout: &Layout, view: &View, arm: Option<&Arm>) {
        let Some(arm) = arm else {
            return;
        };
        let magnification = arm.magnification;
        let place = |sample: &Sample| {
            let (x, y) = (
                f64::from(sample.reach),
                f64::from(sample.deflection) * magnification,
            );
            let (sin, cos) = f64::from(sample.slew).sin_cos();
            view.pixel((x * cos - y * sin, x * sin + y * cos))
        };
        let mut points: Vec<(f64, Point)> = Vec::new();
        for sample in self.past {
            let point = place(sample);
            let far = points.last().is_none_or(|(_, last): &(f64, Point)| {
                (point.0 - last.0).abs() + (point.1 - last.1).abs() > 2.5
            });
            if far {
                points.push((f64::from(sample.time), point));
            }
        }
        points.push((self.moment.time, view.pixel(arm.tip)));
        let recent = points.partition_point(|(time, _)| *time < self.moment.time - 1.5);
        let all: Vec<Point> = points.iter().map(|(_, point)| *point).collect();
        let old = &all[..(recent + 1).min(all.len())];
        canvas.line(old, 1.0, Tone(self.look.colour, 0.5));
        let unit = layout.types.unit;
        canvas.line(&all[recent..], 1.8 * unit, Tone(self.look.colour, 0.75));
    }

    /// A disc with an arc that starts on the axis and turns the way the torque does: 300 degrees
    /// at the limit, and then in another colour.
    fn draw_wheel(
        &self,
        canvas: &mut Canvas,
        centre: Point,
        radius: f64,
        axis: f64,
        place: usize,
        unit: f64,
    ) {
        let (torque, limit) = (
            self.moment.torques[1 + place],
            self.stage.torque_limits[1 + place],
        );
        let (momentum, most) = (
            self.moment.momenta[place],
            self.stage.momentum_limits[place],
        );
        let full = is_saturated(torque, limit) || is_saturated(momentum, most);
        let radius = radius.max(2.5);
        canvas.disc(centre, radius, INK);
        canvas.disc(centre, 0.66 * radius, PAPER);
        let hub = if full { VERMILION } else { INK };
        canvas.disc(centre, 0.34 * radius, hub);
        let share = finite(torque / limit, 0.0).clamp(-1.0, 1.0);
        if share.abs() > 1e-3 {
            let width = (0.3 * radius).max(2.0 * unit);
            let ring = radius + 1.1 * width;
            let turn = share * TAU * 300.0 / 360.0;
            let tone = if full { VERMILION } else { INK };
            canvas.line(&arc(centre, ring, axis, turn), width, tone);
            let end = axis + turn;
            let head = share.signum() * 1.8 * width / ring;
            let at = |r: f64, angle: f64| {
                let (x, y) = polar(r, angle);
                (centre.0 + x, centre.1 - y)
            };
            let arrow = [
                at(ring - 1.2 * width, end),
                at(ring + 1.2 * width, end),
                at(ring, end + head),
            ];
            canvas.polygon(&arrow, tone);
        }
    }
}

/// Distance of lines of text in the scene, units.
const ROW_BELOW: f64 = 16.0;

/// A text cut to a length (px), with dots.
fn shortened(text: &str, kind: Type, room: f64) -> String {
    if font::length(text, kind.weight, kind.size) <= room {
        return text.to_owned();
    }
    let letters: Vec<char> = text.chars().collect();
    let fits = |count: &usize| {
        let cut: String = letters[..*count].iter().collect();
        font::length(&format!("{cut}…"), kind.weight, kind.size) <= room
    };
    let count = (0..letters.len()).rev().find(fits).unwrap_or(0);
    let cut: String = letters[..count].iter().collect();
    format!("{}…", cut.trim_end())
}
