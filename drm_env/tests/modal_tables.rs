//! The frequencies that the thesis prints, each by the recipe in tests/golden/thesis_tables.json.
//! Entries that do not hold are tested for what is true of them.

use std::f64::consts::PI;

use drm_env::analysis::modal::assumed_modes::beam_frequencies;
use drm_env::analysis::modal::exact::{self, Conditions};
use drm_env::analysis::modal::torsion::{self, LINK1, LINK2, OVERLAP};
use drm_env::analysis::modal::{
    AssumedArm, FiniteElementBeam, Kinematics, Root, Segment, TipBody, UniformBeam, appendix_e,
};
use drm_env::arm::mode_shape::ShapeFamily;
use drm_env::arm::{Arm, PayloadInertia, PayloadProperties, TABLE_2_7};
use serde_json::Value;

fn table(name: &str) -> Value {
    let text = include_str!("../../tests/golden/thesis_tables.json");
    let all: Value = serde_json::from_str(text).expect("the golden file is JSON");
    all.get(name)
        .cloned()
        .unwrap_or_else(|| panic!("no table {name}"))
}

/// "P1 a=3 f2", "B8 n=4 w1": the words of an entry's name.
#[derive(Debug, Clone, Copy)]
struct Entry<'a>(&'a str);

impl Entry<'_> {
    fn number(self, prefix: &str) -> f64 {
        let mut words = self.0.split(' ');
        let found = words.find_map(|word| word.strip_prefix(prefix)?.parse().ok());
        found.unwrap_or_else(|| panic!("{} has no {prefix}", self.0))
    }

    fn extension(self) -> f64 {
        self.number("a=")
    }

    /// Index of the frequency.
    fn mode(self) -> usize {
        let letter = if self.0.contains(" f") { "f" } else { "w" };
        self.number(letter) as usize - 1
    }

    fn payload(self, inertia: PayloadInertia) -> PayloadProperties {
        let name = self.0.split(' ').next().expect("an entry has a name");
        let row = ["PNone", "P0", "P1", "P2", "P3"]
            .iter()
            .position(|p| *p == name);
        let (mass, length, width) = TABLE_2_7[row.expect("a payload of Table 2-7")];
        PayloadProperties::new(mass, length, width, inertia)
    }
}

/// Compares every entry of a table; `compute` gives all frequencies of an entry's case.
fn check(name: &str, compute: impl Fn(Entry<'_>) -> Vec<f64>) {
    let table = table(name);
    let tolerance = table["tolerance_percent"].as_f64().expect("a tolerance");
    let values = table["values"].as_object().expect("values");
    assert!(!values.is_empty());
    let mut wrong = Vec::new();
    for (key, printed) in values {
        let entry = Entry(key);
        let computed = compute(entry)[entry.mode()];
        let percent = |value: f64| 100.0 * (computed - value) / value;
        let printed = printed.as_f64().expect("a number");
        let deviating = &table["deviating"][key];
        let holds = if let Some(value) = deviating["true"].as_f64() {
            let tolerance = deviating["tolerance_percent"]
                .as_f64()
                .expect("a tolerance");
            percent(value).abs() <= tolerance
        } else if let Some(range) = deviating["deviation_percent"].as_array() {
            let bound = |i: usize| range[i].as_f64().expect("a bound");
            (bound(0)..=bound(1)).contains(&percent(printed))
        } else {
            assert!(deviating.is_null(), "{name} {key}: nothing to compare");
            percent(printed).abs() <= tolerance
        };
        if !holds {
            wrong.push(format!(
                "{key}: {computed}, {:+.3} % of {printed}",
                percent(printed)
            ));
        }
    }
    assert!(wrong.is_empty(), "{name}: {wrong:#?}");
}

fn hertz(angular: Vec<f64>) -> Vec<f64> {
    angular.into_iter().map(|w| w / (2.0 * PI)).collect()
}

fn published_rigid_link1(entry: Entry<'_>) -> Vec<f64> {
    let payload = entry.payload(PayloadInertia::Full);
    let beam = UniformBeam::rigid_link1(&Arm::default(), &payload, entry.extension());
    hertz(exact::frequencies(&beam, Conditions::AsPublished, 3))
}

fn assumed_rigid_link1(entry: Entry<'_>, shapes: usize) -> Vec<f64> {
    let payload = entry.payload(PayloadInertia::Slender);
    let beam = UniformBeam::rigid_link1(&Arm::default(), &payload, entry.extension());
    hertz(beam_frequencies(&beam, ShapeFamily::B8, shapes))
}

fn thesis_arm(payload: &PayloadProperties, a: f64, family: ShapeFamily, n: usize) -> Vec<f64> {
    let kinematics = Kinematics::Translating;
    hertz(AssumedArm::new(&Arm::default(), payload, a, kinematics, family, [n, n]).frequencies())
}

#[test]
fn table_2_4_exact_frequencies_with_rigid_link_1() {
    check("table_2_4", published_rigid_link1);
}

#[test]
fn table_2_5_assumed_modes_with_rigid_link_1() {
    check("table_2_5", |entry| {
        let shapes = match (entry.0.starts_with("P1 "), entry.extension()) {
            (true, 1.0 | 2.0 | 3.0 | 7.0) => 7,
            (true, 4.0) => 8,
            _ => 3,
        };
        assumed_rigid_link1(entry, shapes)
    });
}

#[test]
fn table_2_8_exact() {
    check("table_2_8_exact", published_rigid_link1);
}

#[test]
fn table_2_8_assumed_modes() {
    check("table_2_8_assumed_modes", |entry| {
        assumed_rigid_link1(entry, 2)
    });
}

#[test]
fn table_2_9_one_mode_a_link() {
    check("table_2_9", |entry| {
        let payload = entry.payload(PayloadInertia::Slender);
        thesis_arm(&payload, entry.extension(), ShapeFamily::B8, 1)
    });
}

#[test]
fn table_2_10_three_families() {
    let payload = Entry("P1").payload(PayloadInertia::Slender);
    for (name, family) in [
        ("table_2_10_B7", ShapeFamily::B7),
        ("table_2_10_B8", ShapeFamily::B8),
        ("table_2_10_B9", ShapeFamily::B9),
    ] {
        check(name, |entry| {
            let shapes = entry.number("n=m=") as usize;
            thesis_arm(&payload, entry.extension(), family, shapes)
        });
    }
}

#[test]
fn table_2_11_finite_elements_of_appendix_e() {
    check("table_2_11", |entry| {
        let case = entry.0.split(' ').nth(1).expect("a case number");
        let (lengths, payload) = match case {
            "1" => ([3.0, 4.0, 4.0], "P0"),
            "2" => ([7.0, 0.0, 8.0], "P0"),
            "3" => ([3.0, 4.0, 4.0], "P1"),
            _ => ([7.0, 0.0, 8.0], "P1"),
        };
        let payload = Entry(payload).payload(PayloadInertia::Full);
        let beam = appendix_e::beam(lengths, &payload);
        hertz(FiniteElementBeam::new(beam, 60).frequencies())
    });
}

#[test]
fn table_2_12_torsion() {
    let table = table("table_2_12");
    let tolerance = table["tolerance_percent"].as_f64().expect("a tolerance");
    for (name, case) in table["values"].as_object().expect("cases") {
        let number = |field: &str| case[field].as_f64().expect("a number");
        let length = |i: usize| case["lengths"][i].as_f64().expect("a length");
        let shaft = [(length(0), LINK1), (length(1), OVERLAP), (length(2), LINK2)];
        let computed = torsion::frequency(&shaft, number("inertia")) / (2.0 * PI);
        let percent = 100.0 * (computed / number("published") - 1.0);
        let allowed = case["tolerance_percent"].as_f64().unwrap_or(tolerance);
        assert!(
            percent.abs() <= allowed,
            "{name}: {computed}, {percent:+.3} %"
        );
    }
}

/// EI = rho = L = 1 with a point mass at the tip.
fn unit_beam(tip_mass: f64) -> UniformBeam {
    UniformBeam {
        root: Root::Clamped,
        segment: Segment {
            length: 1.0,
            mass_per_length: 1.0,
            bending_stiffness: 1.0,
        },
        tip: TipBody {
            mass: tip_mass,
            ..TipBody::default()
        },
    }
}

#[test]
fn tables_b_3_and_b_4_shape_families() {
    for (table, tip_mass) in [("table_B_3", 0.0), ("table_B_4", 100.0)] {
        for (name, family) in [
            ("B7", ShapeFamily::B7),
            ("B8", ShapeFamily::B8),
            ("B9", ShapeFamily::B9),
        ] {
            check(&format!("{table}_{name}"), |entry| {
                let shapes = entry.number("n=") as usize;
                beam_frequencies(&unit_beam(tip_mass), family, shapes)
            });
        }
    }
}

#[test]
fn tables_b_3_and_b_4_exact() {
    for (name, tip_mass) in [("table_B_3_exact", 0.0), ("table_B_4_exact", 100.0)] {
        check(name, |_| {
            exact::frequencies(&unit_beam(tip_mass), Conditions::Correct, 5)
        });
    }
}

#[test]
fn rigid_link_1_agrees_with_another_derivation() {
    check("reference_rigid_link1", |entry| {
        let payload = entry.payload(PayloadInertia::Full);
        let beam = UniformBeam::rigid_link1(&Arm::default(), &payload, entry.extension());
        hertz(exact::frequencies(&beam, Conditions::Correct, 3))
    });
}

#[test]
fn whole_arm_agrees_with_finite_elements_of_another_program() {
    check("reference_arm", |entry| {
        let payload = entry.payload(PayloadInertia::Full);
        let beam = drm_env::analysis::modal::SegmentedBeam::arm(
            &Arm::default(),
            &payload,
            entry.extension(),
        );
        hertz(FiniteElementBeam::new(beam, 60).frequencies())
    });
}
