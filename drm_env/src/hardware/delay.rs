//! Dead time of commands, and delay, noise and quantisation of sensors, of one environment.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::hardware::reaction_wheel::WheelTorques;
use crate::hardware::sensors::{OUTPUTS, Sensors};
use crate::math::rng::Stream;

/// Delay lines and noise of one manoeuvre.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct DelayLines {
    /// Commands on their way to the wheels, oldest first.
    root: VecDeque<f64>,
    tip: VecDeque<f64>,
    /// Outputs on their way to the reader, oldest first.
    sensor: VecDeque<[f64; OUTPUTS]>,
    errors: Sensors,
    noise: Stream,
    /// Of the gyro at the tip wheel: a stream of its own, so that it moves no other noise.
    tip_noise: Stream,
}

/// How long the lines are, in samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Delays {
    pub(crate) root: usize,
    pub(crate) tip: usize,
    pub(crate) sensor: usize,
}

impl Delays {
    /// Whether there is none.
    pub(crate) fn none(&self) -> bool {
        self.root == 0 && self.tip == 0 && self.sensor == 0
    }
}

impl DelayLines {
    /// At t = 0, with zero commands and `output` on their way.
    pub(crate) fn new(
        delays: Delays,
        output: [f64; OUTPUTS],
        errors: Sensors,
        noise: Stream,
    ) -> Self {
        Self {
            root: VecDeque::from(vec![0.0; delays.root]),
            tip: VecDeque::from(vec![0.0; delays.tip]),
            sensor: VecDeque::from(vec![output; delays.sensor]),
            errors,
            tip_noise: noise.beside(),
            noise,
        }
    }

    /// Memory of it, bytes.
    pub(crate) fn bytes(&self) -> usize {
        let numbers = self.root.len() + self.tip.len() + OUTPUTS * self.sensor.len();
        size_of::<Self>() + numbers * size_of::<f64>()
    }

    /// Whether the lines are those of the same manoeuvre at another time.
    pub(crate) fn fits(&self, other: &Self) -> bool {
        self.root.len() == other.root.len()
            && self.tip.len() == other.tip.len()
            && self.sensor.len() == other.sensor.len()
            && self.errors == other.errors
            && self.noise.track() == other.noise.track()
            && self.tip_noise.track() == other.tip_noise.track()
    }

    /// Every number on its way: commands of root and tip wheel, and outputs.
    pub(crate) fn numbers(&self) -> [Vec<f64>; 3] {
        let list = |line: &VecDeque<f64>| line.iter().copied().collect();
        let outputs = self.sensor.iter().flatten().copied().collect();
        [list(&self.root), list(&self.tip), outputs]
    }

    /// Tells the slew angles on their way from another zero, `angle` further on (rad).
    pub(crate) fn turn(&mut self, angle: f64) {
        for output in &mut self.sensor {
            output[0] -= angle;
        }
    }

    /// Sends a command off and returns the one that arrives.
    pub(crate) fn command(&mut self, command: WheelTorques<f64>) -> WheelTorques<f64> {
        let through = |line: &mut VecDeque<f64>, value: f64| {
            line.push_back(value);
            line.pop_front().unwrap_or(value)
        };
        WheelTorques {
            root: through(&mut self.root, command.root),
            tip: through(&mut self.tip, command.tip),
        }
    }

    /// What is read where the outputs are `truth`.
    pub(crate) fn sense(&mut self, truth: [f64; OUTPUTS]) -> [f64; OUTPUTS] {
        self.sensor.push_back(truth);
        let mut measured = self.sensor.pop_front().unwrap_or(truth);
        let noise = self.errors.noise();
        let [at_shoulder @ .., tip] = &noise;
        if at_shoulder.iter().any(|&std| std > 0.0) {
            for (value, std) in measured.iter_mut().zip(at_shoulder) {
                *value += std * self.noise.normal();
            }
        }
        if *tip > 0.0 {
            measured[OUTPUTS - 1] += tip * self.tip_noise.normal();
        }
        for (value, quantum) in measured.iter_mut().zip(self.errors.resolution()) {
            if quantum > 0.0 {
                *value = quantum * libm::round(*value / quantum);
            }
        }
        measured
    }
}
