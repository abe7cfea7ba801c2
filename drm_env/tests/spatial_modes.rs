//! The arm in three dimensions against the plane models, closed forms, and the thesis' appendix E.

use std::f64::consts::PI;

use drm_env::analysis::Model;
use drm_env::analysis::modal::spatial::{Body, Shaft, SpatialBeam, SpatialModes};
use drm_env::analysis::modal::{
    FiniteElementBeam, Root, Segment, SegmentedBeam, TipBody, appendix_e,
};
use drm_env::analysis::model::{Grapple, ModelPlant, ModelSpec};
use drm_env::arm::{Arm, PayloadInertia, PayloadProperties, TABLE_2_7};
use nalgebra::{Matrix3, SMatrix, SymmetricEigen, Vector3};

fn body(mass: f64, centre: [f64; 3], inertia: [f64; 3]) -> Body {
    Body {
        mass,
        centre: centre.into(),
        inertia: Matrix3::from_diagonal(&inertia.into()),
    }
}

/// Frequencies of the modes in which a part of the elastic energy (0 in the plane, 1 out of it, 2
/// torsion) is nearly all.
fn of_kind(modes: &SpatialModes, kind: usize) -> Vec<f64> {
    let pure = modes.shares.iter().map(|share| share[kind] > 1.0 - 1e-6);
    let all = modes.frequencies.iter().zip(pure);
    all.filter_map(|(f, pure)| pure.then_some(*f)).collect()
}

fn assert_close(found: &[f64], expected: &[f64], relative: f64) {
    assert!(found.len() >= expected.len());
    for (found, expected) in found.iter().zip(expected) {
        let error = (found / expected - 1.0).abs();
        assert!(error < relative, "{found} is not {expected}: {error:e}");
    }
}

#[test]
fn a_payload_on_the_axis_couples_nothing() {
    for (mass, length, width) in TABLE_2_7 {
        for extension in [1.0, 4.5, 8.0] {
            let payload = PayloadProperties::new(mass, length, width, PayloadInertia::Full);
            let plane = SegmentedBeam::arm(&Arm::default(), &payload, extension);
            let held = SegmentedBeam {
                root: Root::Clamped,
                ..plane.clone()
            };
            let across = payload.inertia_centre;
            let spatial = SpatialBeam::arm(
                &Arm::default(),
                None,
                body(
                    mass,
                    [length / 2.0, 0.0, 0.0],
                    [mass * width * width / 6.0, across, across],
                ),
                extension,
            );
            let modes = spatial.modes(60, 12, 2);
            for (kind, beam) in [(0, plane), (1, held)] {
                let expected = FiniteElementBeam::new(beam, 60).frequencies();
                let found = of_kind(&modes, kind);
                assert!(found.len() > 2);
                assert_close(&found, &expected[..found.len()], 1e-7);
            }
            assert!(modes.frequencies.is_sorted());
        }
    }
}

/// A shaft with a disc at its end: z tan z = (inertia of the shaft) / (inertia of the disc) with
/// z = w L / c, c^2 = GJ / (inertia per length).
#[test]
fn twist_is_that_of_a_shaft_with_a_disc() {
    let (length, shaft) = (
        3.0,
        Shaft {
            torsional_stiffness: 5e4,
            inertia_per_length: 0.4,
        },
    );
    let speed = (shaft.torsional_stiffness / shaft.inertia_per_length).sqrt();
    let segment = Segment {
        length,
        mass_per_length: 10.0,
        bending_stiffness: 1e9,
    };
    for disc in [0.0, 0.3, 40.0] {
        let spatial = SpatialBeam {
            beam: SegmentedBeam {
                root: Root::PINNED,
                segments: vec![segment],
                tip: TipBody::default(),
            },
            shafts: vec![shaft],
            body: body(0.0, [0.0; 3], [disc, 0.0, 0.0]),
            gimballed: false,
        };
        let found = of_kind(&spatial.modes(80, 60, 2), 2);
        let ratio = shaft.inertia_per_length * length / disc;
        for (k, w) in found.iter().take(3).enumerate() {
            // z tan z grows from 0 to infinity over each half turn
            let (mut low, mut high) = (k as f64 * PI, (k as f64 + 0.5) * PI);
            if disc > 0.0 {
                for _ in 0..80 {
                    let middle = f64::midpoint(low, high);
                    if middle * middle.tan() < ratio {
                        low = middle
                    } else {
                        high = middle
                    }
                }
            }
            let expected = high * speed / length;
            // elements with linear twist: the error grows with the square of w h / c
            let error = (w / expected - 1.0).abs();
            let step = expected * length / 80.0 / speed;
            assert!(
                error < step * step / 20.0,
                "disc {disc}, mode {k}: {w} is not {expected}"
            );
        }
    }
}

/// A heavy body on a beam without mass: stiffness of the tip in closed form.
#[test]
fn a_body_off_the_axis_of_a_massless_beam() {
    let (length, ei, gj) = (8.0, 3e6, 2e6);
    let (mass, inertia) = (300.0, [30.0, 50.0, 60.0]);
    let [x, y] = [0.7, 0.4];
    let spatial = SpatialBeam {
        beam: SegmentedBeam {
            root: Root::PINNED,
            segments: vec![Segment {
                length,
                mass_per_length: 1e-7,
                bending_stiffness: ei,
            }],
            tip: TipBody::default(),
        },
        shafts: vec![Shaft {
            torsional_stiffness: gj,
            inertia_per_length: 1e-9,
        }],
        body: body(mass, [x, y, 0.0], inertia),
        gimballed: false,
    };
    // displacement w, its slope, and twist p of the tip: the body's centre rises by w + x w' + y p
    let stiffness = SMatrix::<f64, 3, 3>::new(
        12.0 * ei / length.powi(3),
        -6.0 * ei / length.powi(2),
        0.0,
        -6.0 * ei / length.powi(2),
        4.0 * ei / length,
        0.0,
        0.0,
        0.0,
        gj / length,
    );
    let rise = Vector3::new(1.0, x, y);
    let mut matrix = mass * rise * rise.transpose();
    matrix[(1, 1)] += inertia[1];
    matrix[(2, 2)] += inertia[0];
    let lower = stiffness.cholesky().expect("the beam is stiff").l();
    let half = lower
        .solve_lower_triangular(&matrix)
        .expect("it is regular");
    let scaled = lower
        .solve_lower_triangular(&half.transpose())
        .expect("it is regular");
    let mut expected: Vec<f64> = SymmetricEigen::new(scaled)
        .eigenvalues
        .iter()
        .map(|value| 1.0 / value.sqrt())
        .collect();
    expected.sort_by(f64::total_cmp);
    let modes = spatial.modes(20, 6, 2);
    for w in expected {
        let near = modes.frequencies.iter().map(|f| (f / w - 1.0).abs());
        assert!(
            near.fold(f64::MAX, f64::min) < 1e-6,
            "{w} is not among {:?}",
            modes.frequencies
        );
    }
}

/// Ratio of the largest twist (rad) to the largest displacement (m) of a mode.
fn twist_per_metre(modes: &SpatialModes, mode: usize) -> f64 {
    let largest = |values: &[f64]| values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let [v, w, twist] = &modes.shapes[mode];
    largest(twist) / largest(v).max(largest(w))
}

/// Appendix E, cases 5 and 7: all ten printed modes but the two rotations, and how much of each is twist.
/// The payload's offset is "20 % off-centre"; 0.2 m in case 5 and a fifth of the width, 0.1 m, in case
/// 7 give the printed splits and twists.
#[test]
fn appendix_e_payloads_off_the_axis() {
    let hertz = |modes: &SpatialModes| -> Vec<f64> {
        modes.frequencies.iter().map(|w| w / (2.0 * PI)).collect()
    };
    let (light, heavy) = (50.0, 200.0);
    // m w^2 / 6 along and m l^2 / 3 across, as for the payloads on the axis; l = w = 0.1 m
    let five = appendix_e::spatial(
        [7.0, 0.0, 8.0],
        light,
        [0.0, -0.2],
        [light * 0.01 / 6.0, light * 0.01 / 3.0, light * 0.01 / 3.0],
    );
    let modes = five.modes(60, 8, 201);
    let printed = [
        3.554433, 3.555206, 12.51962, 12.55711, 27.00447, 27.22175, 46.43032, 47.34746,
    ];
    for (found, printed) in hertz(&modes).iter().zip(printed) {
        assert!(
            (found / printed - 1.0).abs() < 0.01,
            "case 5: {found} is not {printed}"
        );
    }
    for (mode, displacement, twist) in [
        (0, 9.7186580e-02, 2.8156938e-03),
        (2, 1.1225925e-01, 2.4473177e-02),
        (4, 1.0578261e-01, 8.1067316e-02),
    ] {
        let (found, printed) = (twist_per_metre(&modes, mode), twist / displacement);
        assert!(
            (found / printed - 1.0).abs() < 0.1,
            "case 5, mode {mode}: {found}, {printed}"
        );
    }
    // the payload turned, its long side out of the plane: m l^2 / 3 along the arm
    let seven = appendix_e::spatial(
        [7.0, 0.0, 8.0],
        heavy,
        [-0.1, 0.0],
        [heavy / 3.0, heavy * 0.25 / 6.0, heavy * 0.25 / 3.0],
    );
    let modes = seven.modes(60, 8, 201);
    let printed = [
        3.150885, 3.157912, 6.717685, 11.88223, 12.02570, 26.26597, 26.83068, 45.11187,
    ];
    for (found, printed) in hertz(&modes).iter().zip(printed) {
        assert!(
            (found / printed - 1.0).abs() < 0.02,
            "case 7: {found} is not {printed}"
        );
    }
    let torsion = hertz(&modes)[2];
    assert!((torsion / 6.717685 - 1.0).abs() < 0.005, "{torsion}");
    assert!(modes.shares[2][2] > 0.9, "{:?}", modes.shares[2]);
    for (mode, displacement, twist) in [
        (1, 1.0189974e-01, 1.9912340e-03),
        (2, 1.1425268e-02, 1.2193517e-01),
        (4, 1.1601608e-01, 5.8462615e-03),
        (6, 1.0816548e-01, 2.6805841e-03),
    ] {
        let (found, printed) = (twist_per_metre(&modes, mode), twist / displacement);
        assert!(
            (found / printed - 1.0).abs() < 0.1,
            "case 7, mode {mode}: {found}, {printed}"
        );
    }
}

#[test]
fn a_turned_payload_is_its_turned_tensor() {
    let quarter = PI / 2.0;
    let model = |inertia: [f64; 6], rotation: [f64; 3]| {
        let grapple = Grapple {
            centre: Some([0.5, 0.1, -0.2]),
            inertia: Some(inertia),
            rotation,
        };
        let spec = ModelSpec {
            plant: ModelPlant::Spatial,
            grapple: Some(grapple),
            ..ModelSpec::default()
        };
        let model = Model::new(spec).expect("the model exists");
        model
            .natural_frequencies(6.0, Some(8))
            .expect("there are eight")
    };
    let turned = model([10.0, 20.0, 25.0, 0.0, 0.0, 0.0], [0.0, 0.0, quarter]);
    let other = model([20.0, 10.0, 25.0, 0.0, 0.0, 0.0], [0.0; 3]);
    assert_close(&turned, &other, 1e-9);
    // an eighth of a turn makes a product of inertia
    let turned = model([10.0, 20.0, 25.0, 0.0, 0.0, 0.0], [0.0, 0.0, PI / 4.0]);
    let other = model([15.0, 15.0, 25.0, -5.0, 0.0, 0.0], [0.0; 3]);
    assert_close(&turned, &other, 1e-9);
}

#[test]
fn what_no_body_has_is_refused() {
    for (inertia, mass, words) in [
        ([10.0, -1.0, 1.0, 0.0, 0.0, 0.0], 200.0, "grapple.inertia"),
        ([1.0, 1.0, 1.0, 3.0, 0.0, 0.0], 200.0, "grapple.inertia"),
        (
            [1.0, 1.0, f64::NAN, 0.0, 0.0, 0.0],
            200.0,
            "grapple.inertia[2]",
        ),
        ([1.0, 1.0, 1.0, 0.0, 0.0, 0.0], 0.0, "grapple.inertia"),
    ] {
        let mut spec = ModelSpec {
            plant: ModelPlant::Spatial,
            grapple: Some(Grapple {
                inertia: Some(inertia),
                ..Grapple::default()
            }),
            ..ModelSpec::default()
        };
        spec.payload.mass = mass;
        let error = Model::new(spec).expect_err("no body has it").to_string();
        assert!(error.contains(words), "{error}");
    }
    let spec = ModelSpec {
        grapple: Some(Grapple::default()),
        ..ModelSpec::default()
    };
    let error = Model::new(spec)
        .expect_err("the plant is plane")
        .to_string();
    assert!(
        error.contains("grapple") && error.contains("thesis"),
        "{error}"
    );
}
