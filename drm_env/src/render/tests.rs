//! What a frame shows, and what it survives.

use std::f64::consts::PI;

use super::arm::{Arm, MOST_DRAWN_DEFLECTION, longest_reach, payload_radius};
use super::film::{FILM_SIGNALS, Film, moment_of};
use super::font::{self, Weight};
use super::geometry::{Area, Point, polar, rounded_up};
use super::grid::Grid;
use super::palette::{PALETTE, Rgb, STEEL, VERMILION};
use super::scene::{Extent, Look, Moment, Payment, Stage};
use super::tracker::Tracker;
use super::view::View;
use super::{ansi, canvas};

fn distance(a: Point, b: Point) -> f64 {
    (a.0 - b.0).hypot(a.1 - b.1)
}

fn stage() -> Stage {
    Stage {
        link1_length: 7.0,
        link2_length: 8.0,
        target_angle: 0.87,
        path: (0..=20)
            .map(|i| f64::from(i) / 20.0)
            .map(|u| (0.87 * u, 1.0 + 7.0 * u))
            .collect(),
        payload_mass: 200.0,
        reported_mass: 230.0,
        torque_limits: [5000.0, 100.0, 10.0],
        momentum_limits: [f64::INFINITY, 50.0],
        slew_end: 10.0,
        horizon: 20.0,
        magnification: 50.0,
    }
}

fn moment() -> Moment {
    Moment {
        time: 3.0,
        slew_angle: 0.5,
        reference_angle: 0.52,
        extension: 5.0,
        alpha: 0.002,
        beta: 0.004,
        tip_deflection: 0.012,
        torques: [100.0, 40.0, -7.0],
        momenta: [3.0, -2.0],
        payment: None,
    }
}

fn look(width: u32, height: u32) -> Look {
    Look {
        width,
        height,
        title: "a policy".to_owned(),
        colour: [230, 159, 0],
    }
}

/// The picture of one instant of which nothing was seen before.
fn draw(stage: &Stage, moment: &Moment, width: u32, height: u32) -> Vec<u8> {
    let mut tracker = Tracker::new(stage.clone());
    tracker.take(moment, false);
    tracker.draw(&look(width, height))
}

/// Pixels of a colour, as columns and rows.
fn pixels(frame: &[u8], width: usize, colour: Rgb) -> Vec<(usize, usize)> {
    let all = frame.chunks_exact(3).enumerate();
    all.filter(|(_, pixel)| *pixel == colour)
        .map(|(i, _)| (i % width, i / width))
        .collect()
}

const SIZES: [(u32, u32); 9] = [
    (640, 480),
    (800, 450),
    (1280, 720),
    (480, 640),
    (320, 420),
    (320, 240),
    (160, 120),
    (65, 200),
    (1, 1),
];

#[test]
fn a_frame_has_three_bytes_a_pixel_and_is_the_same_every_time() {
    for (width, height) in SIZES {
        let frame = draw(&stage(), &moment(), width, height);
        assert_eq!(frame.len(), (width * height * 3) as usize);
        assert!(frame == draw(&stage(), &moment(), width, height));
    }
    assert!(draw(&stage(), &moment(), 0, 10).is_empty());
}

#[test]
fn whatever_changes_can_be_seen() {
    let first = draw(&stage(), &moment(), 640, 480);
    let changes: [fn(&mut Moment); 9] = [
        |m| m.time = 4.0,
        |m| m.slew_angle = 0.53,
        |m| m.reference_angle = 0.6,
        |m| m.extension = 6.0,
        |m| m.alpha = -0.002,
        |m| m.torques[1] = -40.0,
        |m| m.torques[2] = 3.0,
        |m| m.torques[0] = 900.0,
        |m| m.momenta[1] = 20.0,
    ];
    for (place, change) in changes.into_iter().enumerate() {
        let mut other = moment();
        change(&mut other);
        assert!(first != draw(&stage(), &other, 640, 480), "change {place}");
    }
    let reported = Stage {
        reported_mass: 200.0,
        ..stage()
    };
    assert!(first != draw(&reported, &moment(), 640, 480));
    let payment = Some(Payment {
        terms: [-0.1, -0.2, -0.3],
        sum: -4.0,
    });
    let paid = Moment {
        payment,
        ..moment()
    };
    assert!(first != draw(&stage(), &paid, 640, 480));
}

#[test]
fn the_arm_fills_a_part_of_the_picture() {
    for (width, height) in [(640, 480), (800, 450), (1280, 720)] {
        let at = |slew_angle| {
            let long = Moment {
                extension: 8.0,
                slew_angle,
                ..moment()
            };
            draw(&stage(), &long, width, height)
        };
        // where it is in one of two pictures, and not in the other
        let (one, other) = (at(0.15), at(0.75));
        let moved = one.chunks(3).zip(other.chunks(3)).filter(|(a, b)| a != b);
        let share = moved.count() as f64 / 2.0 / f64::from(width * height);
        assert!(share > 0.015, "{share} of {width} x {height}");
    }
}

#[test]
fn texts_are_there() {
    let blank = Look {
        title: " ".to_owned(),
        ..look(640, 480)
    };
    let mut tracker = Tracker::new(stage());
    tracker.take(&moment(), false);
    let (with, without) = (tracker.draw(&look(640, 480)), tracker.draw(&blank));
    let differing: Vec<usize> = (0..with.len()).filter(|&i| with[i] != without[i]).collect();
    assert!(differing.len() > 300);
    // in the header, and nowhere else
    assert!(differing.iter().all(|i| i / 3 / 640 < 40));
}

#[test]
fn the_fonts_have_what_is_written_with_digits_of_equal_width() {
    let written =
        "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789()%/,.:+\u{2212}×°…";
    for weight in [Weight::Regular, Weight::Bold] {
        let missing = font::length("\u{10FFFF}", weight, 100.0);
        for letter in written.chars() {
            let mut seen = 0;
            font::lay_out(&letter.to_string(), weight, 12.0, 0.0, |_, glyph| {
                seen += glyph.values.iter().filter(|value| **value > 0).count();
            });
            assert!(seen > 0, "{letter:?}");
            // a letter that there is not would be the same box
            if !"mwMW".contains(letter) && missing > 0.0 {
                assert!(font::length(&letter.to_string(), weight, 100.0) > 0.0);
            }
        }
        let widths: Vec<f64> = ('0'..='9')
            .map(|digit| font::length(&digit.to_string(), weight, 100.0))
            .collect();
        assert!(widths.iter().all(|width| *width == widths[0]), "{widths:?}");
    }
}

#[test]
fn saturated_wheels_are_seen() {
    for (width, height) in [(640, 480), (320, 240)] {
        let frame = |torque: f64| {
            let moment = Moment {
                torques: [0.0, torque, 0.0],
                ..moment()
            };
            draw(&stage(), &moment, width, height)
        };
        let reds = |torque| pixels(&frame(torque), width as usize, VERMILION).len();
        assert_eq!(reds(99.0), 0);
        assert!(reds(100.0) > 20 && reds(-100.0) > 20);
    }
    // and a wheel that can store no more
    let full = Moment {
        momenta: [0.0, 50.0],
        ..moment()
    };
    assert!(!pixels(&draw(&stage(), &full, 640, 480), 640, VERMILION).is_empty());
}

#[test]
fn the_drawn_tip_is_the_magnified_deflection() {
    let straight = Moment {
        slew_angle: 0.0,
        ..moment()
    };
    let arm = Arm::bent(&stage(), &straight).unwrap();
    // 50 * 2 * (0.002 + 0.004) across, 7 + 5 along
    assert!(distance(arm.tip, (12.0, 0.6)) < 1e-12);
    assert!(distance(arm.tip, *arm.outer.last().unwrap()) < 1e-12);
    assert!(distance(*arm.link1.last().unwrap(), arm.outer[0]) < 1e-12);
    // 8 - 5 m of link 2 are inside link 1
    assert!(distance(arm.inner[0], polar(4.0, 0.0)) < 0.2);
    // what link 2 turns with the end of link 1 comes on top
    let turned = Moment {
        tip_deflection: 0.02,
        ..straight
    };
    let arm = Arm::bent(&stage(), &turned).unwrap();
    assert!(distance(arm.tip, (12.0, 1.0)) < 1e-12);
}

#[test]
fn a_large_deflection_reduces_the_factor() {
    let bent = Moment {
        slew_angle: 0.0,
        beta: 1.0,
        tip_deflection: 2.004,
        ..moment()
    };
    let arm = Arm::bent(&stage(), &bent).unwrap();
    assert!(arm.reduced && arm.magnification < 50.0);
    assert!((arm.tip.1 - arm.magnification * 2.0 * 1.002).abs() < 1e-12);
    assert!(arm.tip.1 <= MOST_DRAWN_DEFLECTION * longest_reach(&stage()) + 1e-12);
}

#[test]
fn the_area_of_a_payload_is_as_its_mass() {
    let radius = |mass| payload_radius(&stage(), mass).unwrap();
    assert!((radius(400.0) / radius(100.0) - 2.0).abs() < 1e-12);
    assert!(payload_radius(&stage(), 0.0).is_none());
}

#[test]
fn the_camera_stays_during_a_slew_and_sees_all_of_it() {
    let area = Area::new(0.0, 0.0, 640.0, 480.0);
    for target in [0.87, -0.87, 1.5, 3.0] {
        let mut path = stage().path;
        path.iter_mut().for_each(|at| at.0 *= target / 0.87);
        let stage = Stage {
            target_angle: target,
            path,
            ..stage()
        };
        let at = |slew: f64| {
            let extent = Extent {
                slew: [slew.min(0.0), slew.max(0.0)],
                ..Extent::NOTHING
            };
            View::new(&stage, &extent, area)
        };
        let view = at(0.0);
        assert_eq!(view, at(target));
        for &(angle, extension) in &stage.path {
            let (x, y) = view.pixel(polar(7.0 + extension, angle));
            assert!((0.0..640.0).contains(&x) && (0.0..480.0).contains(&y));
        }
        // it follows one that goes astray
        let astray = at(-1.5 * target);
        let (x, y) = astray.pixel(polar(15.0, -1.5 * target));
        assert!((0.0..640.0).contains(&x) && (0.0..480.0).contains(&y));
    }
    // what a slew needs fills one direction of the area
    let view = View::new(&stage(), &Extent::NOTHING, area);
    assert!(view.scale * 15.0 > 300.0, "{}", view.scale);
}

#[test]
fn what_was_before_is_seen_and_forgotten_in_time() {
    let mut tracker = Tracker::new(stage());
    for i in 0..=300 {
        let time = 0.01 * f64::from(i);
        let moment = Moment {
            time,
            slew_angle: time / 6.0,
            ..moment()
        };
        tracker.take(&moment, false);
    }
    let now = *tracker.shown().unwrap();
    let (with, without) = (
        tracker.draw(&look(640, 480)),
        draw(&stage(), &now, 640, 480),
    );
    let differing = (0..with.len() / 3)
        .filter(|i| with[3 * i..3 * i + 3] != without[3 * i..3 * i + 3])
        .count();
    assert!(differing > 300, "{differing}");
    // many more instants than are kept
    for i in 301..30_000 {
        let moment = Moment {
            time: 0.01 * f64::from(i),
            ..moment()
        };
        tracker.take(&moment, false);
    }
    assert!(tracker.remembered() <= 4096 && tracker.remembered() > 1000);
}

#[test]
fn an_impossible_state_is_not_drawn() {
    for (width, height) in [(640, 480), (320, 420), (320, 240), (64, 64)] {
        let mut tracker = Tracker::new(stage());
        tracker.take(&moment(), false);
        let before = tracker.draw(&look(width, height));
        let broken = [
            (|m| m.tip_deflection = -5.6e5) as fn(&mut Moment),
            |m| m.slew_angle = 7.0,
            |m| m.alpha = f64::NAN,
        ];
        for change in broken {
            let mut wrong = Moment {
                time: 3.5,
                ..moment()
            };
            change(&mut wrong);
            tracker.take(&wrong, true);
            let after = tracker.draw(&look(width, height));
            assert!(!pixels(&after, width as usize, VERMILION).is_empty());
            // but for the notice it is the last picture
            let same = (0..before.len()).filter(|&i| before[i] == after[i]).count();
            assert!(same as f64 > 0.9 * before.len() as f64);
            assert_eq!(tracker.time(), Some(3.0));
        }
        assert!(ansi(&stage(), &moment()).contains("drawn x50"));
    }
    let wrong = Moment {
        alpha: f64::NAN,
        ..moment()
    };
    assert!(ansi(&stage(), &wrong).contains("diverged"));
}

#[test]
fn a_film_shows_what_a_tracker_has_shown() {
    let moments: Vec<Moment> = (0..=200)
        .map(|i| f64::from(i) / 10.0)
        .map(|time| Moment {
            time,
            slew_angle: 0.04 * time,
            ..moment()
        })
        .collect();
    let mut film = Film::new(stage(), moments.clone(), false);
    let mut tracker = Tracker::new(stage());
    moments
        .iter()
        .for_each(|moment| tracker.take(moment, false));
    let look = look(640, 480);
    assert!(film.draw(&look, 20.0) == tracker.draw(&look));
    // any instant, in any order
    let early = film.draw(&look, 5.0);
    assert!(early != film.draw(&look, 15.0));
    assert!(early == film.draw(&look, 5.05));
    let extent = *film.extent();
    assert!((extent.slew[1] - 0.8).abs() < 1e-12);
    // beside another flight the axes are wider
    let wide = Extent {
        error: [-50.0, 60.0],
        ..Extent::NOTHING
    };
    film.widen(&wide);
    assert!(early != film.draw(&look, 5.0));
}

#[test]
fn a_film_ends_where_no_arm_can_be() {
    let mut moments = vec![moment(); 3];
    moments[1].time = 3.5;
    moments[2].time = 4.0;
    moments[2].tip_deflection = 1e9;
    let mut film = Film::new(stage(), moments, false);
    let look = look(640, 480);
    assert!(pixels(&film.draw(&look, 3.9), 640, VERMILION).is_empty());
    assert!(!pixels(&film.draw(&look, 4.0), 640, VERMILION).is_empty());
    assert_eq!(film.extent().deflection, [0.0, 0.012]);
}

#[test]
fn rows_of_signals_become_instants() {
    let row: [f64; FILM_SIGNALS.len()] = std::array::from_fn(|i| i as f64);
    let found = moment_of(&row);
    for (name, value) in [
        ("time", found.time),
        ("reference_angle", found.reference_angle),
        ("beta", found.beta),
        ("tip_deflection", found.tip_deflection),
        ("root_torque", found.torques[1]),
        ("tip_momentum", found.momenta[1]),
    ] {
        let place = FILM_SIGNALS.iter().position(|signal| *signal == name);
        assert_eq!(place, Some(value as usize), "{name}");
    }
}

#[test]
fn a_grid_has_a_place_for_each() {
    for count in [1, 2, 3, 4, 7, 12, 16] {
        let grid = Grid::new(count, (1280, 720));
        assert!(grid.columns * grid.rows >= count);
        assert!(grid.columns * (grid.rows - 1) < count);
        let (width, height) = grid.tile();
        let tile = |shade: u8| vec![shade; (3 * width * height) as usize];
        let whole = grid.join((0..count).map(|i| tile(i as u8)));
        assert_eq!(whole.len(), 3 * 1280 * 720);
        for i in 0..count {
            let seen = pixels(&whole, 1280, [i as u8; 3]).len();
            assert_eq!(seen, (width * height) as usize, "{i} of {count}");
        }
    }
}

#[test]
fn a_curve_covers_what_it_passes() {
    let mut canvas = canvas::Canvas::new(100, 50, [255; 3]).unwrap();
    // up and down within one column of pixels
    let points = [
        (10.0, 25.0),
        (50.2, 25.0),
        (50.4, 5.0),
        (50.6, 45.0),
        (50.8, 25.0),
        (90.0, 25.0),
    ];
    canvas.curve(&points, 2.0, [0; 3]);
    let frame = canvas.to_rgb();
    let dark = |x: usize, y: usize| frame[3 * (100 * y + x)] < 128;
    assert!(dark(20, 25) && dark(80, 25) && !dark(20, 20) && !dark(80, 30));
    assert!(dark(50, 6) && dark(50, 44) && !dark(50, 2) && !dark(50, 47));
    assert!(!dark(5, 25) && !dark(95, 25));
}

#[test]
fn a_thin_line_has_the_ink_of_its_length() {
    // whole or dashed, at any angle, also where it leaves the picture: one pixel thick along its minor axis
    let cases = [
        ((10.3, 20.0), (80.6, 31.7), 70.3),
        ((80.6, 31.7), (10.3, 20.0), 70.3),
        ((10.0, 40.0), (15.0, 5.0), 35.0),
        ((20.0, 20.5), (70.0, 20.5), 50.0),
        ((20.5, 10.25), (20.5, 39.75), 29.5),
        ((30.0, 10.0), (55.0, 35.0), 25.0),
        ((-40.0, 25.0), (140.0, 25.0), 100.0),
        ((50.0, -1e5), (50.0, 1e5), 50.0),
        ((50.0, 70.0), (90.0, 60.0), 0.0),
        ((12.0, 12.0), (12.0, 12.0), 0.0),
    ];
    for (from, to, length) in cases {
        for (opacity, dash) in [(1.0, None), (0.5, None), (1.0, Some([2.0, 3.0]))] {
            let mut canvas = canvas::Canvas::new(100, 50, [255; 3]).unwrap();
            canvas.dashed(&[from, to], 1.0, canvas::Tone([0; 3], opacity), dash);
            let ink: f64 = canvas
                .to_rgb()
                .iter()
                .step_by(3)
                .map(|value| (255.0 - f64::from(*value)) / 255.0)
                .sum();
            let (part, rest) = dash.map_or((1.0, 0.0), |[ink, gap]| (ink / (ink + gap), 1.5));
            let expected = opacity * part * length;
            // half a step of each pixel's 255, and a dash more or less
            let most = 100.0 * 2.0 * 0.5 / 255.0 + rest;
            assert!((ink - expected).abs() < most, "{from:?} {to:?} {ink}");
        }
    }
}

#[test]
fn axes_end_at_round_numbers() {
    let decades = [
        (0.0, 0.0),
        (1.0, 1.0),
        (1.1, 2.0),
        (0.0205, 0.03),
        (9.0, 10.0),
        (99.0, 100.0),
    ];
    for (value, round) in decades {
        assert!((rounded_up(value) - round).abs() < 1e-9, "{value}");
    }
}

#[test]
fn no_two_colours_are_alike() {
    for (i, (_, first)) in PALETTE.iter().enumerate() {
        for (_, second) in &PALETTE[i + 1..] {
            let apart: i32 = first
                .iter()
                .zip(second)
                .map(|(a, b)| (i32::from(*a) - i32::from(*b)).abs())
                .sum();
            assert!(apart > 60);
        }
        assert_ne!(*first, STEEL);
    }
}

#[test]
fn odd_values_do_not_panic() {
    let values = [
        f64::NAN,
        f64::INFINITY,
        -f64::INFINITY,
        0.0,
        -1.0,
        1e300,
        1e-300,
    ];
    let stages: [fn(&mut Stage, f64); 12] = [
        |s, v| s.link1_length = v,
        |s, v| s.link2_length = v,
        |s, v| s.target_angle = v,
        |s, v| s.path = vec![(v, 1.0), (0.3, v)],
        |s, v| s.payload_mass = v,
        |s, v| s.reported_mass = v,
        |s, v| s.torque_limits = [v; 3],
        |s, v| s.momentum_limits = [v; 2],
        |s, v| s.slew_end = v,
        |s, v| s.horizon = v,
        |s, v| s.magnification = v,
        |s, _| s.path.clear(),
    ];
    let moments: [fn(&mut Moment, f64); 10] = [
        |m, v| m.time = v,
        |m, v| m.slew_angle = v,
        |m, v| m.reference_angle = v,
        |m, v| m.extension = v,
        |m, v| m.alpha = v,
        |m, v| m.beta = v,
        |m, v| m.tip_deflection = v,
        |m, v| m.torques = [v; 3],
        |m, v| m.momenta = [v; 2],
        |m, v| {
            m.payment = Some(Payment {
                terms: [v; 3],
                sum: v,
            });
        },
    ];
    for value in values {
        for (width, height) in [(640, 480), (64, 64), (320, 420)] {
            for change in stages {
                let mut stage = stage();
                change(&mut stage, value);
                assert_eq!(
                    draw(&stage, &moment(), width, height).len(),
                    (width * height * 3) as usize
                );
                assert_eq!(ansi(&stage, &moment()).lines().count(), 26);
            }
            for change in moments {
                let mut moment = moment();
                change(&mut moment, value);
                assert_eq!(
                    draw(&stage(), &moment, width, height).len(),
                    (width * height * 3) as usize
                );
                assert_eq!(ansi(&stage(), &moment).lines().count(), 26);
            }
        }
    }
}

#[test]
fn the_tip_follows_the_sign_of_beta() {
    let tip = |slew_angle: f64, beta: f64| {
        let moment = Moment {
            slew_angle,
            beta,
            alpha: 0.0,
            tip_deflection: 2.0 * beta,
            ..moment()
        };
        Arm::bent(&stage(), &moment).unwrap().tip
    };
    assert!(tip(0.0, 0.01).1 > tip(0.0, 0.0).1 && tip(0.0, 0.0).1 > tip(0.0, -0.01).1);
    assert!(tip(PI / 2.0, 0.01).0 < tip(PI / 2.0, -0.01).0);
}

#[test]
fn a_text_picture_shows_the_parts() {
    let picture = ansi(&stage(), &moment());
    for symbol in ["=", "#", "-", "@", "O", "x50", "+28.65", "230.0 kg"] {
        assert!(picture.contains(symbol), "{symbol} missing in\n{picture}");
    }
    assert!(picture.lines().take(24).all(|line| line.len() <= 60));
}
