//! Environments side by side in a pack fly bit for bit as each of them alone.

use std::sync::Arc;

use crate::arm::{Arm, PayloadInertia, PayloadProperties, TABLE_2_7};
use crate::math::generalized_alpha::GeneralizedAlpha;
use crate::plant::consistent::arm_tables::Slots;
use crate::plant::consistent::{CAPACITY, ConsistentLanes, ConsistentPlant, ConsistentState};
use crate::plant::{Dynamics, TipTorque, Torques};
use crate::reference::Extension;
use crate::reference::timeline::Piece;
#[cfg(target_arch = "x86_64")]
use crate::simd::Instructions;
use crate::simd::{Lane, Pack};

/// Environments, as many as the widest pack has lanes.
const COUNT: usize = 8;
const STEPS: usize = 120;

/// A payload of table 2-7: 0 is none, 1 to 4 are the thesis' Payloads 0 to 3.
fn payload(row: usize) -> PayloadProperties {
    let (mass, length, width) = TABLE_2_7[row];
    PayloadProperties::new(mass, length, width, PayloadInertia::Full)
}

/// A piece of timeline without a slew reference.
fn moving(length: f64, rate: f64, accel: f64) -> Piece<f64> {
    Piece {
        start: 0.0,
        angle: 0.0,
        rate: 0.0,
        accel: [0.0; 4],
        extension: length,
        extension_rate: rate,
        extension_accel: accel,
    }
}

/// One environment and its flight, told by its number.
struct Single {
    plant: ConsistentPlant,
    number: usize,
    /// Whether any lane deploys.
    deploying: bool,
}

impl Single {
    fn new(number: usize, modes: (usize, usize), deploying: bool) -> Self {
        let dynamics = Dynamics {
            structural_damping: [0.0, 1e-4][number % 2],
            tip_torque: [TipTorque::SlewAndTip, TipTorque::TipOnly][number / 4],
            ..Dynamics::default()
        };
        let (arm, payload) = (Arm::default(), payload(number % 5));
        let plant = ConsistentPlant::new(&arm, &payload, &dynamics, modes, (1.0, 8.0));
        Self {
            plant: plant.expect("the plant exists"),
            number,
            deploying,
        }
    }

    /// The state that a step begins a new flight with, if it does.
    fn reset(&self, step: usize) -> Option<ConsistentState> {
        let number = self.number as f64;
        let starts = step == 0 || step == 11 * self.number;
        // one whose deflections are zero has zeros everywhere
        let bent = if self.number == 6 { 0.0 } else { 1e-3 };
        starts.then(|| {
            self.plant.released(
                (0.1 * number, 0.05 * number),
                (bent, 0.0),
                (-2.0 * bent, bent),
            )
        })
    }

    fn active(&self, step: usize) -> bool {
        !(step + 3 * self.number).is_multiple_of(7)
    }

    fn length(&self) -> f64 {
        5e-4 * (1.0 - 0.05 * self.number as f64)
    }

    /// At rest, at a steady rate, accelerated; from half of the steps on the acceleration is another.
    fn piece(&self, step: usize) -> Piece<f64> {
        let number = self.number as f64;
        if !self.deploying || self.number.is_multiple_of(3) {
            return moving(1.0 + 0.9 * number, 0.0, 0.0);
        }
        let accel = if step < STEPS / 2 { 0.1 } else { -0.2 };
        moving(
            1.0 + 0.8 * number,
            0.4,
            accel * f64::from(self.number % 3 == 2),
        )
    }

    fn from(&self, step: usize) -> f64 {
        step as f64 * self.length()
    }

    fn torques(&self, step: usize) -> [Torques<f64>; 3] {
        let number = self.number as f64;
        // held over 20 steps
        let held = (step / 20) as f64;
        let at = |part: f64| Torques {
            slew: 100.0 * number + 3.0 * part * (step % 2) as f64,
            root: 7.0 * held,
            tip: if self.number == 6 { 0.0 } else { held - number },
        };
        [at(0.0), at(0.5), at(1.0)]
    }
}

/// States of every lane after every step, each flown alone; by the step.
fn alone(singles: &[Single]) -> Vec<Vec<ConsistentState>> {
    let scheme = GeneralizedAlpha::default();
    let fly = |single: &Single| {
        let mut state = single.reset(0).expect("a flight starts");
        let step = |step: usize| {
            state = single.reset(step).unwrap_or(state);
            if single.active(step) {
                single.plant.step(
                    &scheme,
                    &mut state,
                    &single.torques(step),
                    &single.piece(step),
                    single.from(step),
                    single.length(),
                );
            }
            state
        };
        (0..STEPS).map(step).collect()
    };
    let flights: Vec<Vec<ConsistentState>> = singles.iter().map(fly).collect();
    (0..STEPS)
        .map(|step| flights.iter().map(|flight| flight[step]).collect())
        .collect()
}

/// The same side by side, a pack after the other, compared after every step. `USUAL`: the step of four
/// modes a link is the only one that is compiled.
#[inline(always)]
fn fly_together<T: Lane, const USUAL: bool>(
    singles: &[Single],
    alone: &[Vec<ConsistentState>],
    name: &str,
) {
    for first in (0..singles.len()).step_by(T::WIDTH) {
        fly_pack::<T, USUAL>(&singles[first..][..T::WIDTH], first, alone, name);
    }
}

#[inline(always)]
fn fly_pack<T: Lane, const USUAL: bool>(
    singles: &[Single],
    first: usize,
    alone: &[Vec<ConsistentState>],
    name: &str,
) {
    let scheme = GeneralizedAlpha::default();
    let zero = T::splat(0.0);
    let mut lanes = ConsistentLanes::<T>::new(&singles[0].plant);
    for (lane, single) in singles.iter().enumerate() {
        assert!(lanes.set_lane(lane, &single.plant));
    }
    let mut state = ConsistentState::new([zero; CAPACITY], [zero; CAPACITY]);
    for (step, alone) in alone.iter().enumerate() {
        let (mut active, mut h) = (zero, zero);
        let mut torques = [Torques {
            slew: zero,
            root: zero,
            tip: zero,
        }; 3];
        let mut extension = Extension {
            length: zero,
            rate: zero,
            accel: zero,
        };
        for (lane, single) in singles.iter().enumerate() {
            if let Some(fresh) = single.reset(step) {
                state.set_lane(lane, &fresh);
            }
            active.set_lane(lane, f64::from(single.active(step)));
            h.set_lane(lane, single.length());
            for (all, one) in torques.iter_mut().zip(single.torques(step)) {
                all.slew.set_lane(lane, one.slew);
                all.root.set_lane(lane, one.root);
                all.tip.set_lane(lane, one.tip);
            }
            let place = single.from(step) + scheme.balance_point() * single.length();
            let at: Extension<f64> = single.piece(step).extension(place);
            extension.length.set_lane(lane, at.length);
            extension.rate.set_lane(lane, at.rate);
            extension.accel.set_lane(lane, at.accel);
        }
        if USUAL {
            const S4: usize = Slots::new(4).count;
            let args = (&scheme, &torques, &extension, h, active, None);
            lanes.step_of::<9, S4, 10>((4, 4), &mut state, args, None);
        } else {
            lanes.step(&scheme, &mut state, &torques, &extension, h, (active, None));
        }
        let outputs = lanes.outputs(&state, &extension);
        for (lane, single) in singles.iter().enumerate() {
            let (found, expected) = (state.lane(lane), &alone[first + lane]);
            assert_eq!(found, *expected, "{name} lane {lane} step {step}");
            assert!(found.is_finite(), "{name} lane {lane} step {step}");
            for (x, y) in found
                .q
                .iter()
                .chain(&found.v)
                .zip(expected.q.iter().chain(&expected.v))
            {
                assert_eq!(x.to_bits(), y.to_bits(), "{name} lane {lane} step {step}");
            }
            let at = Extension {
                length: extension.length.lane(lane),
                rate: extension.rate.lane(lane),
                accel: extension.accel.lane(lane),
            };
            for (seen, expected) in [
                (outputs.link1, single.plant.link1_deflection(expected)),
                (outputs.link2, single.plant.link2_deflection(expected)),
                (outputs.tip, single.plant.tip_deflection(expected, &at)),
            ] {
                let near = |x: f64, y: f64| (x - y).abs() <= 1e-13 * (1.0 + y.abs());
                assert!(near(seen[0].lane(lane), expected.0), "{name} lane {lane}");
                assert!(near(seen[1].lane(lane), expected.1), "{name} lane {lane}");
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx2,fma")]
fn fly_avx512(singles: &[Single], alone: &[Vec<ConsistentState>]) {
    fly_together::<crate::simd::x86::Wide8, true>(singles, alone, "AVX-512");
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn fly_avx2(singles: &[Single], alone: &[Vec<ConsistentState>]) {
    fly_together::<crate::simd::x86::Wide4, true>(singles, alone, "AVX2");
}

/// Different payloads, dampings, extensions and steps; some lanes at rest, flights that start and
/// steps that are sat out at different times, forces that jump in some lanes. Every number of modes has
/// the two lanes of any processor; the wide registers, of which each step is a large function, have the
/// usual number here, and all of them in `tests/lanes.rs`, which flies what the library has compiled.
#[test]
fn a_lane_of_a_pack_has_the_bits_of_its_environment_alone() {
    for (modes, deploying) in [
        ((4, 4), true),
        ((4, 4), false),
        ((2, 2), true),
        ((1, 3), true),
        ((8, 8), true),
    ] {
        let singles: Vec<Single> = (0..COUNT)
            .map(|number| Single::new(number, modes, deploying))
            .collect();
        let expected = alone(&singles);
        fly_together::<Pack<2>, false>(&singles, &expected, "pack");
        #[cfg(target_arch = "x86_64")]
        if modes == (4, 4) {
            if Instructions::detect() >= Instructions::Avx512 {
                // SAFETY: the processor has the features that the function is compiled for
                unsafe { fly_avx512(&singles, &expected) };
            }
            if Instructions::detect() >= Instructions::Avx2 {
                // SAFETY: the processor has the features that the function is compiled for
                unsafe { fly_avx2(&singles, &expected) };
            }
        }
    }
}

/// What depends on the arm alone is made once; a plant of another arm cannot fly beside.
#[test]
fn plants_of_one_arm_share_what_depends_on_it_alone() {
    let plant = |row: usize, axial_load: bool, modes: (usize, usize), range: (f64, f64)| {
        let dynamics = Dynamics {
            axial_load,
            ..Dynamics::default()
        };
        ConsistentPlant::new(&Arm::default(), &payload(row), &dynamics, modes, range)
            .expect("the plant exists")
    };
    let first = plant(2, true, (4, 4), (1.0, 8.0));
    let beside = plant(4, true, (4, 4), (2.0, 3.0));
    assert!(Arc::ptr_eq(first.arm(), beside.arm()));
    let mut lanes = ConsistentLanes::<Pack<COUNT>>::new(&first);
    assert!(lanes.set_lane(3, &beside));
    let before = lanes.clone();
    for other in [
        plant(2, false, (4, 4), (1.0, 8.0)),
        plant(2, true, (4, 3), (1.0, 8.0)),
    ] {
        assert!(!Arc::ptr_eq(first.arm(), other.arm()));
        assert!(!lanes.set_lane(3, &other));
        assert_eq!(lanes, before);
    }
}
