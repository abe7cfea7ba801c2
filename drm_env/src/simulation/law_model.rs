//! The arm as laws that model it know it: reported payload, believed stiffness.

use super::Flight;
use crate::arm::PayloadProperties;
use crate::arm::mode_shape::ShapeFamily;
use crate::config::scenario::Scenario;
use crate::control::lean::{AGAIN, Prescribed, planned_torque};
use crate::control::servo::{MODES, Mode, Node};
use crate::control::{Measurement, ServoLaw, ServoModel};
use crate::error::ConfigError;
use crate::plant::consistent::{ConsistentPlant, Kinematics, LowModes};
use crate::plant::{Dynamics, PlantModel, RigidInertia};
use crate::simd::mask::everyone;
use crate::simd::{Laned, Number};

/// Least extension that the servo's model knows, as a part of link 2.
const SHORTEST_PART: f64 = 0.125;

/// Modes a link of the servo's model, and how they move: those of the plant that its user flies.
fn kinematics(plant: PlantModel) -> ((usize, usize), Kinematics) {
    match plant {
        PlantModel::Consistent => ((4, 4), Kinematics::default()),
        PlantModel::Thesis => (
            (1, 1),
            Kinematics {
                shapes: ShapeFamily::B8,
                slope_turning: false,
            },
        ),
    }
}

/// The servo's model of the arm of a scenario with a payload as it is reported.
///
/// # Errors
/// An arm or a payload that cannot be.
pub fn servo_model(
    scenario: &Scenario,
    reported: &PayloadProperties,
    servo: &ServoLaw,
) -> Result<ServoModel<f64>, ConfigError> {
    let mut arm = scenario.arm;
    let [link1, link2] = servo.bending_stiffness;
    (arm.link1.bending_stiffness, arm.link2.bending_stiffness) = (link1, link2);
    // a link 2 no longer than link 1 could be drawn in whole: no arm bends at no length
    let shortest = arm
        .shortest_extension()
        .max(arm.link2.length * SHORTEST_PART);
    let range = (shortest, arm.link2.length);
    let alone = PayloadProperties {
        mass: 0.0,
        inertia_centre: 0.0,
        inertia_attachment: 0.0,
        ..*reported
    };
    let inertias = (
        RigidInertia::new(&arm, &alone).coefficients(),
        RigidInertia::of_payload(&arm, reported).coefficients(),
    );
    let limits = [
        scenario.root_wheel.torque_limit,
        scenario.tip_wheel.torque_limit,
    ];
    let (modes, kinematics) = kinematics(scenario.plant);
    let mut made: Option<(f64, ConsistentPlant)> = None;
    ServoModel::new(
        range,
        arm.link1.length,
        inertias,
        limits,
        |extension, part| {
            if made.as_ref().is_none_or(|(of, _)| *of != part) {
                let payload = PayloadProperties {
                    mass: reported.mass * part,
                    inertia_centre: reported.inertia_centre * part,
                    inertia_attachment: reported.inertia_attachment * part,
                    ..*reported
                };
                let plant = ConsistentPlant::with_kinematics(
                    &arm,
                    &payload,
                    &Dynamics::default(),
                    modes,
                    range,
                    kinematics,
                )?;
                made = Some((part, plant));
            }
            let (_, plant) = made.as_ref().expect("it has been made");
            let LowModes { modes, tilt, tip } = plant.low_modes::<MODES>(extension)?;
            Ok(Node {
                modes: modes.map(|[frequency, root, tip]| Mode {
                    frequency,
                    root,
                    tip,
                }),
                tilt,
                tip,
            })
        },
    )
}

/// Models of the manoeuvres in the lanes.
#[derive(Debug, Clone)]
pub(super) struct Modelled<T> {
    /// What they are of.
    servo: ServoLaw,
    pub(super) model: ServoModel<T>,
    /// Lanes whose model is made, a bit each.
    made: u32,
}

impl<T> Modelled<T> {
    /// Another manoeuvre has taken a lane.
    pub(super) fn forget(&mut self, lane: usize) {
        self.made &= !(1 << lane);
    }
}

impl<T: Number> Flight<T> {
    /// Makes the models that are not made yet.
    #[inline(always)]
    pub(crate) fn model_for(&mut self, servo: &ServoLaw) {
        let ready = self
            .modelled
            .as_ref()
            .is_some_and(|modelled| modelled.made == everyone::<T>() && modelled.servo == *servo);
        if !ready {
            self.make_models(servo);
        }
    }

    /// Plans anew what the wheels should give, in the lanes where the time for it has come.
    #[inline(never)]
    pub(super) fn plan_torques(&mut self, measured: &Measurement<T>, share: f64) {
        let between = (AGAIN / self.shared.sample_period).round().max(1.0);
        for lane in 0..T::WIDTH {
            let Some(modelled) = &self.modelled else {
                return;
            };
            if self.common.sample.lane(lane) % between != 0.0 {
                continue;
            }
            let model = modelled.model.lane_of(lane);
            let mut memory = self.common.memory.servo.lane_of(lane);
            let state = memory.state(&measured.lane_of(lane), &model);
            let times = (
                self.clock.time.lane(lane),
                self.fixed.slew_end_time.lane(lane),
            );
            let timeline = &self.manoeuvres[lane].timeline;
            let at = |time: f64| {
                let (extension, reference) = (timeline.extension(time), timeline.reference(time));
                Prescribed {
                    extension: [extension.length, extension.rate],
                    slew: [reference.rate, reference.accel],
                }
            };
            memory.plan(planned_torque(at, times, &model, state, share));
            self.common.memory.servo.put_lane(lane, &memory);
        }
    }

    #[inline(never)]
    fn make_models(&mut self, servo: &ServoLaw) {
        for lane in 0..T::WIDTH {
            let known = self
                .modelled
                .as_ref()
                .is_some_and(|modelled| modelled.servo == *servo && modelled.made >> lane & 1 == 1);
            if known {
                continue;
            }
            let scenario = self.scenario_of(lane);
            // the manoeuvre flies, so its arm and its payload can be
            let Ok(model) = scenario
                .reported()
                .and_then(|reported| servo_model(&scenario, &reported, servo))
            else {
                continue;
            };
            match &mut self.modelled {
                Some(modelled) if modelled.servo == *servo => {
                    modelled.model.put_lane(lane, &model);
                    modelled.made |= 1 << lane;
                }
                other => {
                    *other = Some(Box::new(Modelled {
                        servo: *servo,
                        model: ServoModel::spread(&model),
                        made: 1 << lane,
                    }));
                }
            }
        }
    }
}
