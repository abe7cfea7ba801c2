//! Dead time of commands, and bandwidth, delay, bias, noise and quantisation of sensors, of one environment.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::hardware::reaction_wheel::WheelTorques;
use crate::hardware::sensors::{INSTRUMENTS, OUTPUTS, Sensors, TIP_RATE};
use crate::math::rng::Stream;

/// Delay lines and noise of one manoeuvre.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct DelayLines {
    /// Commands on their way to the wheels, oldest first.
    root: VecDeque<f64>,
    tip: VecDeque<f64>,
    /// Outputs on their way to the reader, oldest first.
    sensor: VecDeque<[f64; OUTPUTS]>,
    /// What the sensors' low passes have let pass.
    passed: [f64; OUTPUTS],
    errors: Sensors,
    noise: Stream,
    /// Of the gyro at the tip wheel: a stream of its own, so that it moves no other noise.
    tip_noise: Stream,
    /// Of each instrument, for the same reason.
    instrument_noise: [Stream; INSTRUMENTS],
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
            passed: output,
            errors,
            tip_noise: noise.beside(0),
            instrument_noise: [1, 2, 3].map(|which| noise.beside(which)),
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
            && self.instrument_noise.each_ref().map(Stream::track)
                == other.instrument_noise.each_ref().map(Stream::track)
    }

    /// Every number on its way: commands of root and tip wheel, and outputs with what the low passes hold.
    pub(crate) fn numbers(&self) -> [Vec<f64>; 3] {
        let list = |line: &VecDeque<f64>| line.iter().copied().collect();
        let outputs = self.sensor.iter().flatten().chain(&self.passed);
        let outputs = outputs.copied().collect();
        [list(&self.root), list(&self.tip), outputs]
    }

    /// Tells the slew angles on their way from another zero, `angle` further on (rad).
    pub(crate) fn turn(&mut self, angle: f64) {
        for output in self.sensor.iter_mut().chain([&mut self.passed]) {
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

    /// What is read where the outputs are `truth`, a sample period (s) after the last reading. The low passes
    /// are exact for what is held between samples, as the torques of motor and wheels are.
    pub(crate) fn sense(&mut self, truth: [f64; OUTPUTS], period: f64) -> [f64; OUTPUTS] {
        let before = std::mem::replace(&mut self.passed, truth);
        for (i, cutoff) in self.errors.bandwidth().iter().enumerate() {
            if let Some(cutoff) = cutoff {
                let decay = libm::exp(-cutoff * period);
                self.passed[i] = (before[i] - truth[i]).mul_add(decay, truth[i]);
            }
        }
        self.sensor.push_back(self.passed);
        let mut measured = self.sensor.pop_front().unwrap_or(self.passed);
        for (value, bias) in measured.iter_mut().zip(self.errors.bias()) {
            // nothing, not even the sign of a zero, moves without one
            if bias != 0.0 {
                *value += bias;
            }
        }
        let noise = self.errors.noise();
        let (at_shoulder, at_tip) = noise.split_at(TIP_RATE);
        if at_shoulder.iter().any(|&std| std > 0.0) {
            for (value, std) in measured.iter_mut().zip(at_shoulder) {
                *value += std * self.noise.normal();
            }
        }
        let streams = std::iter::once(&mut self.tip_noise).chain(&mut self.instrument_noise);
        let others = measured[TIP_RATE..].iter_mut().zip(at_tip).zip(streams);
        for ((value, std), stream) in others {
            if *std > 0.0 {
                *value += std * stream.normal();
            }
        }
        for (value, quantum) in measured.iter_mut().zip(self.errors.resolution()) {
            if quantum > 0.0 {
                *value = quantum * libm::round(*value / quantum);
            }
        }
        measured
    }
}
