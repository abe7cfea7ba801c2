//! The slew of a scenario as it is flown: shaped over the frequency of the arm as it is modelled.

use std::f64::consts::PI;

use crate::arm::PayloadProperties;
use crate::config::scenario::Scenario;
use crate::error::ConfigError;
use crate::math::quadrature::{gauss_legendre, integrate};
use crate::plant::consistent::{ConsistentPlant, Kinematics, LowModes};
use crate::plant::thesis_modes::elastic_frequencies;
use crate::plant::{Dynamics, PlantModel};
use crate::reference::deployment::DeploymentPiece;
use crate::reference::shaped::shaped;
use crate::reference::shaping::ShaperKind;
use crate::reference::slew::SlewPiece;

/// Lengths at which the frequency is found; between them it is a polynomial.
const NODES: usize = 14;
/// Spans of a half period in which the phase is integrated.
const SPANS: usize = 4;
/// Rounds of Newton's iteration for an instant of a phase.
const ROUNDS: usize = 50;

/// Angular frequency of the lowest mode over the extension, a series of Chebyshev polynomials.
struct Frequency {
    middle: f64,
    per_half: f64,
    coefficients: Vec<f64>,
}

impl Frequency {
    fn new(
        (low, high): (f64, f64),
        mut of: impl FnMut(f64) -> Result<f64, ConfigError>,
    ) -> Result<Self, ConfigError> {
        let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
        if half == 0.0 {
            return Ok(Self {
                middle,
                per_half: 0.0,
                coefficients: vec![of(middle)?],
            });
        }
        let angles: Vec<f64> = (0..NODES)
            .map(|k| PI * (k as f64 + 0.5) / NODES as f64)
            .collect();
        let mut values = Vec::with_capacity(NODES);
        for angle in &angles {
            values.push(of(middle + half * libm::cos(*angle))?);
        }
        let coefficients = (0..NODES)
            .map(|i| {
                let sum: f64 = angles
                    .iter()
                    .zip(&values)
                    .map(|(angle, value)| value * libm::cos(i as f64 * angle))
                    .sum();
                sum * if i == 0 { 1.0 } else { 2.0 } / NODES as f64
            })
            .collect();
        Ok(Self {
            middle,
            per_half: 1.0 / half,
            coefficients,
        })
    }

    fn at(&self, extension: f64) -> f64 {
        let x = (extension - self.middle) * self.per_half;
        let (mut before, mut now, mut sum) = (x, 1.0, 0.0);
        for coefficient in &self.coefficients {
            sum += coefficient * now;
            (before, now) = (now, 2.0 * x * now - before);
        }
        sum
    }
}

impl Scenario {
    /// The pieces of the slew that is flown, from t = 0, the last of which (at rest) has no end. `deployment` are those
    /// of the length.
    ///
    /// # Errors
    /// An arm, a payload or a profile that cannot be shaped.
    pub(crate) fn slew_pieces(
        &self,
        deployment: &[DeploymentPiece],
    ) -> Result<Vec<SlewPiece>, ConfigError> {
        let plain = self.slew.pieces();
        let shaper = &self.slew.shaper;
        if shaper.kind == ShaperKind::None || plain.len() < 2 {
            return Ok(plain);
        }
        let within = |e: ConfigError| e.within("shaper").within("slew");
        let parts = shaper.parts();
        let damped = shaper.damped();
        if let Some(frequency) = shaper.frequency {
            let half = PI / (frequency * damped);
            return shaped(&plain, &parts, |_, i| half * i as f64).map_err(within);
        }
        let (from, to) = (self.deployment.start, self.deployment.final_extension());
        let frequency = self.lowest_frequency((from.min(to), from.max(to)))?;
        let at = |time: f64| {
            let index = deployment.partition_point(|p| p.start <= time).max(1) - 1;
            let piece = &deployment[index];
            damped * frequency.at(piece.at((time - piece.start).max(0.0)).0)
        };
        if from == to {
            let half = PI / at(0.0);
            return shaped(&plain, &parts, |_, i| half * i as f64).map_err(within);
        }
        let rule = gauss_legendre(8);
        let phase = |start: f64, span: f64| -> f64 {
            // the frequency has a kink in its slope where the length's acceleration changes
            let mut cuts = vec![start, start + span];
            cuts.extend(
                deployment
                    .iter()
                    .map(|p| p.start)
                    .filter(|t| (start..start + span).contains(t)),
            );
            cuts.sort_by(f64::total_cmp);
            let mut sum = 0.0;
            for pair in cuts.windows(2) {
                let part = (pair[1] - pair[0]) / SPANS as f64;
                for i in 0..SPANS {
                    let low = pair[0] + part * i as f64;
                    sum += integrate(&rule, low, low + part, at);
                }
            }
            sum
        };
        let delay = |start: f64, halves: usize| {
            let target = PI * halves as f64;
            let mut span = target / at(start);
            for _ in 0..ROUNDS {
                let change = (target - phase(start, span)) / at(start + span);
                span = (span + change).max(0.0);
                if change.abs() < 1e-14 * (1.0 + span) {
                    break;
                }
            }
            span
        };
        shaped(&plain, &parts, delay).map_err(within)
    }

    /// How long the slew that is flown takes, s.
    ///
    /// # Errors
    /// See [`Scenario::slew_pieces`].
    pub(crate) fn slew_time(&self, deployment_start: f64) -> Result<f64, ConfigError> {
        if self.slew.shaper.kind == ShaperKind::None {
            return Ok(self.slew.final_time());
        }
        let pieces = self.slew_pieces(&self.deployment_pieces(deployment_start)?)?;
        Ok(pieces.last().map_or(0.0, |piece| piece.start))
    }

    /// The pieces of the length, which begins to change at `start` (s).
    ///
    /// # Errors
    /// A payload that cannot be reported.
    pub(crate) fn deployment_pieces(
        &self,
        start: f64,
    ) -> Result<Vec<DeploymentPiece>, ConfigError> {
        let mut pieces = self
            .deployment
            .pieces(self.deployment_time(&self.reported()?));
        if start > 0.0 {
            let at_rest = DeploymentPiece {
                start: 0.0,
                rate: 0.0,
                accel: 0.0,
                ..pieces[0]
            };
            for piece in &mut pieces {
                piece.start += start;
            }
            pieces.insert(0, at_rest);
        }
        Ok(pieces)
    }

    /// Of the arm as the shaper believes it, with the payload as it is reported.
    fn lowest_frequency(&self, range: (f64, f64)) -> Result<Frequency, ConfigError> {
        let mut arm = self.arm;
        let [link1, link2] = self.slew.shaper.bending_stiffness;
        (arm.link1.bending_stiffness, arm.link2.bending_stiffness) = (link1, link2);
        let reported: PayloadProperties = self.reported()?;
        match self.plant {
            PlantModel::Thesis => {
                Frequency::new(range, |a| Ok(elastic_frequencies(&arm, &reported, a)[0]))
            }
            PlantModel::Consistent => {
                let plant = ConsistentPlant::with_kinematics(
                    &arm,
                    &reported,
                    &Dynamics::default(),
                    (4, 4),
                    range,
                    Kinematics::default(),
                )?;
                Frequency::new(range, |a| {
                    let LowModes { modes, .. } = plant.low_modes::<1>(a)?;
                    Ok(modes[0][0])
                })
            }
        }
    }
}
