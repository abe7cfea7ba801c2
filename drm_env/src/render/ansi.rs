//! A picture of letters, for terminals.

use super::arm::{Arm, longest_reach};
use super::geometry::{Area, Point, mix, polar};
use super::scene::{Extent, Moment, Stage};
use super::text::{ascii_number, factor};
use super::view::View;

/// An instant as 24 lines of up to 60 characters and two lines of readings, in ASCII.
///
/// `=` link 1, `#` link 2 inside it, `-` link 2 outside, `@` payload, `O` shoulder, `o` tip,
/// `:` reference direction, `.` target direction.
pub fn ansi(stage: &Stage, moment: &Moment) -> String {
    const COLUMNS: usize = 60;
    const ROWS: usize = 24;
    let arm = if moment.is_possible(stage) {
        Arm::bent(stage, moment)
    } else {
        None
    };
    let reach = longest_reach(stage);
    // A character cell is about twice as high as wide.
    let area = Area::new(0.0, 0.0, COLUMNS as f64, 2.0 * ROWS as f64).within(1.0, 1.0);
    let mut extent = Extent::NOTHING;
    extent.take(stage, moment);
    let view = View::new(stage, &extent, area);
    let mut cells = vec![b' '; COLUMNS * ROWS];
    let mut mark = |point: Point, symbol: u8| {
        let (x, y) = view.pixel(point);
        let (column, row) = (x.floor(), (y / 2.0).floor());
        if (0.0..COLUMNS as f64).contains(&column) && (0.0..ROWS as f64).contains(&row) {
            cells[row as usize * COLUMNS + column as usize] = symbol;
        }
    };
    for (angle, symbol) in [(stage.target_angle, b'.'), (moment.reference_angle, b':')] {
        if angle.is_finite() {
            (1..=60).for_each(|i| mark(polar(reach * f64::from(i) / 60.0, angle), symbol));
        }
    }
    if let Some(arm) = &arm {
        let parts = [(&arm.link1, b'='), (&arm.inner, b'#'), (&arm.outer, b'-')];
        for (points, symbol) in parts {
            for ends in points.windows(2) {
                for i in 0..=8 {
                    mark(mix(ends[0], ends[1], f64::from(i) / 8.0), symbol);
                }
            }
        }
        if let Some(radius) = arm.load.radius {
            for i in 0..=8 {
                for j in 0..=24 {
                    let (x, y) = polar(radius * f64::from(i) / 8.0, 0.27 * f64::from(j));
                    mark((arm.load.centre.0 + x, arm.load.centre.1 + y), b'@');
                }
            }
        }
        mark(arm.tip, b'o');
    }
    mark((0.0, 0.0), b'O');
    let mut picture = String::with_capacity((COLUMNS + 1) * (ROWS + 2));
    for row in cells.chunks(COLUMNS) {
        picture.push_str(String::from_utf8_lossy(row).trim_end());
        picture.push('\n');
    }
    let drawn = arm.map_or_else(
        || "diverged, no arm can be there".to_owned(),
        |arm| format!("drawn x{}", factor(arm.magnification)),
    );
    let number = |value: f64, decimals| ascii_number(value, decimals, true);
    let percent = |place: usize| {
        number(
            100.0 * moment.torques[place] / stage.torque_limits[place],
            0,
        )
    };
    format!(
        "{picture}time {} s of {} s | slew angle {} deg | reference {} deg\n\
         tip deflection {} mm | tip error {} mm | payload {} kg, reported {} kg | \
         wheels {} / {} % root/tip | {drawn}\n",
        ascii_number(moment.time, 2, false),
        ascii_number(stage.horizon, 1, false),
        number(moment.slew_angle.to_degrees(), 2),
        number(moment.reference_angle.to_degrees(), 2),
        number(moment.tip_deflection * 1e3, 2),
        number(moment.tip_error(stage) * 1e3, 2),
        ascii_number(stage.payload_mass, 1, false),
        ascii_number(stage.reported_mass, 1, false),
        percent(1),
        percent(2),
    )
}
