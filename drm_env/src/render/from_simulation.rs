//! What a picture of a flight shows at the present instant.

use crate::render::Scene;
use crate::simulation::Flight;

/// Factor by which deflections are drawn larger than they are: centimetres on an arm of 15 m.
pub const MAGNIFICATION: f64 = 20.0;

/// The scene of a flight now.
pub fn scene(flight: &Flight) -> Scene {
    let scenario = flight.scenario();
    // a payload that has been flown can be resolved
    let (mass, length, width) = scenario.true_payload().map_or((0.0, 0.0, 0.0), |payload| {
        (payload.mass, payload.length, payload.width)
    });
    let reference = flight.reference();
    let extension = flight.extension();
    let [slew_angle, alpha, beta] = flight.position();
    let [_, root_torque, tip_torque] = flight.last_torques();
    let tip_deflection = flight.tip_deflection().0;
    let reach = scenario.arm.link1.length + extension.length;
    Scene {
        link1_length: scenario.arm.link1.length,
        link2_length: scenario.arm.link2.length,
        slew_angle,
        reference_angle: reference.angle,
        target_angle: scenario.slew.angle,
        extension: extension.length,
        alpha,
        beta,
        turning: tip_deflection - 2.0 * (alpha + beta),
        payload_length: length,
        payload_width: width,
        payload_mass: mass,
        root_torque: root_torque / scenario.root_wheel.torque_limit,
        tip_torque: tip_torque / scenario.tip_wheel.torque_limit,
        time: flight.time(),
        slew_end_time: flight.slew_end(),
        tip_deflection,
        tip_error: reach * (slew_angle - reference.angle) + tip_deflection,
        magnification: MAGNIFICATION,
    }
}
