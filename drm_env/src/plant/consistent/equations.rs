//! The matrices of the equations of motion over the lengths of a manoeuvre, from the integrals.

use nalgebra::DMatrix;

use super::field::{Field, Integrals};
use super::table::{Interval, Sampled, Table};
use crate::plant::Dynamics;

/// Tables of what acts at rest (M, Kb, Z) and of what a moving link 2 adds (the factors of a' in C, of
/// a'' and of a'^2 in K, and dZ/da), for extensions within `range` (m).
pub(super) fn tabulate(field: &Field, dynamics: &Dynamics, range: (f64, f64)) -> (Table, Table) {
    let interval = Interval::new(range.0, range.1, field.nodes());
    let load = if dynamics.axial_load { 1.0 } else { 0.0 };
    let sums: Vec<Integrals> = interval
        .lengths()
        .iter()
        .map(|a| Integrals::new(field, *a))
        .collect();
    let sampled = |power: usize, f: &dyn Fn(&Integrals) -> DMatrix<f64>| Sampled {
        values: sums.iter().map(f).collect(),
        power,
        plain: 1 + field.link1.len(),
    };
    let mass = sampled(2, &|s| s.mass.clone());
    let bending = sampled(3, &|s| s.bending.clone());
    let turning = sampled(2, &|s| &s.offset - &s.centrifugal * load);
    let drift = sampled(3, &|s| s.drift.clone());
    let (mass_slope, drift_slope) = (mass.derivative(&interval), drift.derivative(&interval));
    let turning_slope = turning
        .derivative(&interval)
        .map(3, |_, m| (m + m.transpose()) * 0.5);
    let size = field.size();
    let gyroscopic = mass_slope.map(3, |node, slope| {
        let s = &sums[node];
        let mut c = slope + &s.drift - s.drift.transpose();
        for i in 1..size {
            c[(0, i)] -= s.offset_line[i];
            c[(i, 0)] += s.offset_line[i];
        }
        c
    });
    let accelerated = sampled(3, &|s| {
        let mut k = &s.drift - &s.thrust * load;
        for i in 1..size {
            k[(0, i)] -= s.offset_line[i];
        }
        k
    });
    let squared = drift_slope.map(4, |node, slope| {
        let s = &sums[node];
        let mut k = slope - &s.drift_square;
        for i in 1..size {
            k[(0, i)] -= s.drift_line[i];
        }
        k
    });
    (
        Table::new(&interval, &[&mass, &bending, &turning]),
        Table::new(
            &interval,
            &[&gyroscopic, &accelerated, &squared, &turning_slope],
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arm::{Arm, PayloadInertia, PayloadProperties};
    use crate::shape::ShapeFamily;

    /// Between its nodes a table has the integrals' values to rounding, and its rates of change are
    /// their differences.
    #[test]
    fn tables_are_exact_to_rounding() {
        let payload = PayloadProperties::new(500.0, 2.0, 1.0, PayloadInertia::Full);
        for (family, modes) in [
            (ShapeFamily::Mono, (1, 1)),
            (ShapeFamily::Mono, (4, 4)),
            (ShapeFamily::Mono, (8, 8)),
            (ShapeFamily::B9, (3, 4)),
        ] {
            let field = Field::new(&Arm::default(), &payload, family, modes, true);
            let size = field.size();
            let (still, moving) = tabulate(&field, &Dynamics::default(), (1.0, 8.0));
            let square = size * size;
            let slope = |f: &dyn Fn(&Integrals) -> DMatrix<f64>, a: f64| {
                let h = 1e-4;
                (f(&Integrals::new(&field, a + h)) - f(&Integrals::new(&field, a - h))) / (2.0 * h)
            };
            // table, exact, what rounding is measured by
            type Case = (DMatrix<f64>, DMatrix<f64>, DMatrix<f64>);
            let cases = |a: f64| -> [Case; 5] {
                let sums = Integrals::new(&field, a);
                let (mut flat, mut moved) = (vec![0.0; 3 * square], vec![0.0; 4 * square]);
                still.evaluate(a, &mut flat);
                moving.evaluate(a, &mut moved);
                let read = |flat: &[f64], slot: usize| {
                    DMatrix::from_row_slice(size, size, &flat[slot * square..(slot + 1) * square])
                };
                let turning = |s: &Integrals| &s.offset - &s.centrifugal;
                // terms that cancel are as exact as they are large
                let growth = slope(&|s| s.drift.clone(), a);
                let mut squared = &growth - &sums.drift_square;
                for i in 1..size {
                    squared[(0, i)] -= sums.drift_line[i];
                }
                let same = |table, exact: DMatrix<f64>| (table, exact.clone(), exact);
                [
                    same(read(&flat, 0), sums.mass.clone()),
                    same(read(&flat, 1), sums.bending.clone()),
                    same(read(&flat, 2), turning(&sums)),
                    same(read(&moved, 3), slope(&turning, a)),
                    (
                        read(&moved, 2),
                        squared,
                        growth.abs() + sums.drift_square.abs(),
                    ),
                ]
            };
            let all = [1.0, 1.37, 2.9, 5.1, 7.77, 8.0].map(cases);
            // the last two against differences
            for (kind, tolerance) in [1e-11, 1e-11, 1e-11, 1e-6, 1e-6].into_iter().enumerate() {
                let largest = |i: usize, j: usize| {
                    all.iter().fold(0.0, |most: f64, cases| {
                        most.max(cases[kind].2[(i, j)].abs())
                    })
                };
                let sizes = DMatrix::from_fn(size, size, largest);
                for cases in &all {
                    let difference = &cases[kind].0 - &cases[kind].1;
                    for i in 0..size {
                        for j in 0..size {
                            let scale = libm::sqrt(sizes.row(i).max() * sizes.column(j).max());
                            let error = difference[(i, j)].abs();
                            assert!(
                                error <= tolerance * scale,
                                "{family:?} {modes:?} matrix {kind} {i} {j}: {error:e} of {scale:e}"
                            );
                        }
                    }
                }
            }
        }
    }
}
