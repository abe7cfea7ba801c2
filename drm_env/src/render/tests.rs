//! What a frame shows, and what it survives.

use super::*;

fn distance(a: Point, b: Point) -> f64 {
    (a.0 - b.0).hypot(a.1 - b.1)
}

fn scene() -> Scene {
    Scene {
        link1_length: 7.0,
        link2_length: 8.0,
        slew_angle: 0.5,
        reference_angle: 0.52,
        target_angle: 0.87,
        extension: 5.0,
        alpha: 0.002,
        beta: 0.004,
        turning: 0.0,
        payload_length: 1.0,
        payload_width: 0.5,
        payload_mass: 200.0,
        root_torque: 0.4,
        tip_torque: -0.7,
        time: 3.0,
        slew_end_time: 10.0,
        tip_deflection: 0.012,
        tip_error: 0.02,
        magnification: 50.0,
    }
}

/// Mean column and row of the payload's pixels.
fn payload_centre(scene: &Scene) -> Point {
    let (mut columns, mut rows, mut count) = (0.0, 0.0, 0.0);
    for (i, pixel) in draw(scene, 320, 320).chunks_exact(3).enumerate() {
        if pixel == GREEN {
            columns += (i % 320) as f64;
            rows += (i / 320) as f64;
            count += 1.0;
        }
    }
    assert!(count > 20.0, "payload not visible");
    (columns / count, rows / count)
}

#[test]
fn buffer_has_three_bytes_a_pixel() {
    for (width, height) in [(64, 64), (65, 200), (640, 480), (1, 1), (0, 10)] {
        let frame = draw(&scene(), width, height);
        assert_eq!(frame.len(), (width * height * 3) as usize);
    }
}

#[test]
fn same_scene_same_frame_and_other_scene_other_frame() {
    let first = draw(&scene(), 200, 200);
    assert_eq!(first, draw(&scene(), 200, 200));
    assert_ne!(
        first,
        draw(
            &Scene {
                slew_angle: 0.6,
                ..scene()
            },
            200,
            200
        )
    );
    assert_ne!(
        first,
        draw(
            &Scene {
                root_torque: -0.4,
                ..scene()
            },
            200,
            200
        )
    );
}

#[test]
fn tip_follows_the_sign_of_beta() {
    let at = |slew_angle: f64, beta: f64| {
        payload_centre(&Scene {
            slew_angle,
            beta,
            alpha: 0.0,
            ..scene()
        })
    };
    let (up, rest, down) = (at(0.0, 0.01), at(0.0, 0.0), at(0.0, -0.01));
    assert!(
        up.1 + 3.0 < rest.1 && rest.1 + 3.0 < down.1,
        "{up:?} {rest:?} {down:?}"
    );
    let (left, right) = (at(PI / 2.0, 0.01), at(PI / 2.0, -0.01));
    assert!(left.0 + 6.0 < right.0, "{left:?} {right:?}");
}

#[test]
fn drawn_tip_is_the_magnified_deflection() {
    let arm = Arm::new(&Scene {
        slew_angle: 0.0,
        ..scene()
    });
    let shape = arm.shape.unwrap();
    // 50 * 2 * (0.002 + 0.004) across, 7 + 5 along.
    assert!(distance(shape.tip, (12.0, 0.6)) < 1e-12);
    assert!(distance(shape.tip, shape.outer[96]) < 1e-12);
    assert!(distance(shape.link1[96], shape.outer[0]) < 1e-12);
    assert!(distance(shape.inner[0], polar(4.0, 0.0)) < 0.2);
}

#[test]
fn large_deflection_reduces_the_factor() {
    let arm = Arm::new(&Scene {
        slew_angle: 0.0,
        beta: 1.0,
        ..scene()
    });
    assert!(arm.reduced && arm.magnification < 50.0);
    let drawn = arm.shape.unwrap().tip.1;
    assert!((drawn - arm.magnification * 2.0 * 1.002).abs() < 1e-12);
    assert!(drawn <= MAX_DRAWN_DEFLECTION * 16.0 + 1e-12);
}

#[test]
fn camera_stays_during_a_slew() {
    let origin = |slew_angle: f64, target_angle: f64| {
        let scene = Scene {
            slew_angle,
            target_angle,
            ..scene()
        };
        View::new(&scene, 16.0, (0.0, 0.0, 640.0, 640.0)).origin
    };
    assert_eq!(origin(0.0, 1.5), origin(1.6, 1.5));
    assert!(origin(0.0, 1.5).1 > 400.0 && origin(0.0, -1.5).1 < 240.0);
    assert!(distance(origin(0.0, 3.0), (320.0, 320.0)) < 1e-9);
}

#[test]
fn odd_values_do_not_panic() {
    let fields: [fn(&mut Scene) -> &mut f64; 18] = [
        |s| &mut s.link1_length,
        |s| &mut s.link2_length,
        |s| &mut s.slew_angle,
        |s| &mut s.reference_angle,
        |s| &mut s.target_angle,
        |s| &mut s.extension,
        |s| &mut s.alpha,
        |s| &mut s.beta,
        |s| &mut s.payload_length,
        |s| &mut s.payload_width,
        |s| &mut s.payload_mass,
        |s| &mut s.root_torque,
        |s| &mut s.tip_torque,
        |s| &mut s.time,
        |s| &mut s.slew_end_time,
        |s| &mut s.tip_deflection,
        |s| &mut s.tip_error,
        |s| &mut s.magnification,
    ];
    for value in [
        f64::NAN,
        f64::INFINITY,
        -f64::INFINITY,
        0.0,
        -1.0,
        1e300,
        1e-300,
    ] {
        let mut all = scene();
        for field in fields {
            let mut one = scene();
            *field(&mut one) = value;
            *field(&mut all) = value;
            assert_eq!(draw(&one, 64, 64).len(), 64 * 64 * 3);
            assert_eq!(ansi(&one).lines().count(), 26);
        }
        for size in [64, 400] {
            assert_eq!(draw(&all, size, size).len(), (size * size * 3) as usize);
        }
        assert_eq!(ansi(&all).lines().count(), 26);
    }
}

#[test]
fn text_picture_shows_the_parts() {
    let picture = ansi(&scene());
    for symbol in ["=", "#", "-", "@", "O", "x50", "+28.65"] {
        assert!(picture.contains(symbol), "{symbol} missing in\n{picture}");
    }
    assert!(picture.lines().take(24).all(|line| line.len() <= 60));
}
