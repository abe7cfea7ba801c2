//! Feed-forward networks, of which learned policies are made, for every lane at once.
//!
//! Weights and observations are what they are in training, numbers of single precision; the
//! arithmetic is that of the lanes, in double precision, and the action is rounded to single
//! precision at the end. The order of the sums depends on the shape of the network alone, so a
//! lane's bits do not depend on the width.

use crate::error::{ConfigError, SimulationError};
use crate::simd::Lane;
use crate::simd::functions::{tanh, tanh_coarse};

/// Layers that a network may have.
pub const MAX_LAYERS: usize = 64;

/// Inputs and outputs that a layer may have.
pub const MAX_SIZE: usize = 4096;

/// Outputs computed side by side: as many sums as a processor needs to be busy, and for each input
/// that is loaded so many products.
const BLOCK: usize = 8;

/// Function after every layer but the last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activation {
    /// Hyperbolic tangent.
    Tanh,
    /// What is negative becomes zero.
    Relu,
}

/// What makes actions between -1 and 1 of the last layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Output {
    /// Limits (Gaussian policies).
    Clip,
    /// Hyperbolic tangent (squashed Gaussian policies).
    Tanh,
}

/// One dense layer: as many outputs as biases.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Outputs x inputs, row by row.
    pub weights: Vec<f32>,
    /// One for each output.
    pub biases: Vec<f32>,
}

/// A multilayer perceptron from observations to actions in -1..=1.
#[derive(Debug, Clone, PartialEq)]
pub struct Network {
    inputs: usize,
    widest: usize,
    layers: Vec<Dense>,
    activation: Activation,
    output: Output,
}

/// Memory that [`Network::act`] uses again at every call.
#[derive(Debug, Clone, Default)]
pub struct Scratch<T> {
    values: Vec<T>,
    next: Vec<T>,
}

impl<T> Scratch<T> {
    /// Nothing yet; the first call takes what it needs.
    pub fn new() -> Self {
        Self {
            values: Vec::new(),
            next: Vec::new(),
        }
    }
}

impl Network {
    /// Puts layers together.
    ///
    /// # Errors
    /// No layer or too many; a layer that is empty or too large, whose weights do not fit its biases
    /// or the layer before, or that holds a number that is not finite.
    pub fn new(
        layers: &[Layer],
        activation: Activation,
        output: Output,
    ) -> Result<Self, ConfigError> {
        if layers.is_empty() || layers.len() > MAX_LAYERS {
            return Err(ConfigError::value(
                "layers",
                format!("must hold 1 to {MAX_LAYERS} layers"),
                layers.len(),
            ));
        }
        let mut dense: Vec<Dense> = Vec::with_capacity(layers.len());
        for (index, layer) in layers.iter().enumerate() {
            let before = dense.last().map(|layer| layer.outputs);
            let made = Dense::new(layer, before)
                .map_err(|error| error.within(&format!("layers[{index}]")))?;
            dense.push(made);
        }
        let inputs = dense.first().map_or(0, |layer| layer.inputs);
        Ok(Self {
            inputs,
            widest: dense
                .iter()
                .map(|layer| layer.outputs)
                .fold(inputs, usize::max),
            layers: dense,
            activation,
            output,
        })
    }

    /// Entries of an observation.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Entries of an action.
    pub fn outputs(&self) -> usize {
        self.layers.last().map_or(0, |layer| layer.outputs)
    }

    /// Action of an observation, lane by lane, each a number of single precision in -1..=1; where an
    /// observation is not a number, neither is the action.
    ///
    /// # Errors
    /// An observation or action of another length than [`Self::inputs`] or [`Self::outputs`].
    #[inline(always)]
    pub fn act<T: Lane>(
        &self,
        observation: &[T],
        scratch: &mut Scratch<T>,
        action: &mut [T],
    ) -> Result<(), SimulationError> {
        check("observation", self.inputs(), observation.len())?;
        check("action", self.outputs(), action.len())?;
        let Some((last, hidden)) = self.layers.split_last() else {
            return Ok(());
        };
        let Scratch { values, next } = scratch;
        for buffer in [&mut *values, next] {
            buffer.clear();
            buffer.reserve(self.widest);
        }
        values.extend_from_slice(observation);
        for layer in hidden {
            next.resize(layer.outputs, T::splat(0.0));
            match self.activation {
                Activation::Tanh => layer.apply(values, next, CoarseTanh),
                Activation::Relu => layer.apply(values, next, Relu),
            }
            std::mem::swap(values, next);
        }
        match self.output {
            Output::Clip => last.apply(values, action, Clip),
            Output::Tanh => last.apply(values, action, Tanh),
        }
        for value in action {
            for lane in 0..T::WIDTH {
                value.set_lane(lane, f64::from(value.lane(lane) as f32));
            }
        }
        Ok(())
    }
}

#[inline(always)]
fn check(name: &'static str, expected: usize, got: usize) -> Result<(), SimulationError> {
    if got == expected {
        Ok(())
    } else {
        Err(SimulationError::Length {
            name,
            expected,
            got,
        })
    }
}

/// What is done to the sums of a layer.
trait Finish: Copy {
    fn of<T: Lane>(self, sum: T) -> T;
}

#[derive(Clone, Copy)]
struct Tanh;

impl Finish for Tanh {
    #[inline(always)]
    fn of<T: Lane>(self, sum: T) -> T {
        tanh(sum)
    }
}

/// Good enough between layers: its error is a hundred-thousandth of what rounding to single precision
/// would make.
#[derive(Clone, Copy)]
struct CoarseTanh;

impl Finish for CoarseTanh {
    #[inline(always)]
    fn of<T: Lane>(self, sum: T) -> T {
        tanh_coarse(sum)
    }
}

#[derive(Clone, Copy)]
struct Relu;

impl Finish for Relu {
    #[inline(always)]
    fn of<T: Lane>(self, sum: T) -> T {
        T::splat(0.0).max(sum)
    }
}

#[derive(Clone, Copy)]
struct Clip;

impl Finish for Clip {
    #[inline(always)]
    fn of<T: Lane>(self, sum: T) -> T {
        T::splat(1.0).min(T::splat(-1.0).max(sum))
    }
}

/// A layer as it is computed: its outputs in blocks of 8, then of 4, 2 and 1 for what is left. A
/// block has its biases first, then the weights of each input in turn.
#[derive(Debug, Clone, PartialEq)]
struct Dense {
    inputs: usize,
    outputs: usize,
    numbers: Vec<f64>,
}

impl Dense {
    /// `before`: outputs of the layer before.
    fn new(layer: &Layer, before: Option<usize>) -> Result<Self, ConfigError> {
        let Layer { weights, biases } = layer;
        let outputs = biases.len();
        if outputs == 0 || outputs > MAX_SIZE {
            let requirement = format!("must hold 1 to {MAX_SIZE} numbers");
            return Err(ConfigError::value("biases", requirement, outputs));
        }
        let inputs = before.unwrap_or(weights.len() / outputs);
        if inputs == 0 || inputs > MAX_SIZE || inputs * outputs != weights.len() {
            let requirement = if before.is_some() {
                format!("must hold {outputs} x {inputs} numbers")
            } else {
                format!("must hold {outputs} rows of 1 to {MAX_SIZE} numbers")
            };
            return Err(ConfigError::value("weights", requirement, weights.len()));
        }
        finite("weights", weights)?;
        finite("biases", biases)?;
        let rows: Vec<&[f32]> = weights.chunks_exact(inputs).collect();
        let mut numbers = Vec::with_capacity(weights.len() + outputs);
        let mut first = 0;
        for size in [BLOCK, 4, 2, 1] {
            while first + size <= outputs {
                let block = first..first + size;
                numbers.extend(biases[block.clone()].iter().map(|bias| f64::from(*bias)));
                for input in 0..inputs {
                    numbers.extend(rows[block.clone()].iter().map(|row| f64::from(row[input])));
                }
                first += size;
            }
        }
        Ok(Self {
            inputs,
            outputs,
            numbers,
        })
    }

    /// Values to sums to what is made of them.
    #[inline(always)]
    fn apply<T: Lane, F: Finish>(&self, values: &[T], sums: &mut [T], finish: F) {
        let numbers = &self.numbers[..];
        let (numbers, sums) = blocks::<T, F, BLOCK, 1>(numbers, values, sums, finish);
        let (numbers, sums) = blocks::<T, F, 4, 2>(numbers, values, sums, finish);
        let (numbers, sums) = blocks::<T, F, 2, 4>(numbers, values, sums, finish);
        blocks::<T, F, 1, 8>(numbers, values, sums, finish);
    }
}

fn finite(name: &str, numbers: &[f32]) -> Result<(), ConfigError> {
    match numbers.iter().position(|number| !number.is_finite()) {
        Some(index) => Err(ConfigError::value(
            format!("{name}[{index}]"),
            "must be finite",
            numbers[index],
        )),
        None => Ok(()),
    }
}

/// As many blocks of `SIZE` outputs as there are; what is left of the numbers and of the outputs.
#[inline(always)]
fn blocks<'a, 'b, T: Lane, F: Finish, const SIZE: usize, const PARTS: usize>(
    mut numbers: &'a [f64],
    values: &[T],
    sums: &'b mut [T],
    finish: F,
) -> (&'a [f64], &'b mut [T]) {
    let (whole, left) = sums.as_chunks_mut::<SIZE>();
    for outputs in whole {
        let (block, rest) = numbers
            .split_at_checked(SIZE * (values.len() + 1))
            .unwrap_or_default();
        let sums = block_sums::<T, SIZE, PARTS>(block, values);
        for (output, sum) in outputs.iter_mut().zip(sums) {
            *output = finish.of(sum);
        }
        numbers = rest;
    }
    (numbers, left)
}

/// Sums of one block. Few outputs are summed in several parts, which a processor adds to at the same
/// time: input `i` belongs to part `i % PARTS`.
#[inline(always)]
fn block_sums<T: Lane, const SIZE: usize, const PARTS: usize>(
    block: &[f64],
    values: &[T],
) -> [T; SIZE] {
    let mut parts = [[T::splat(0.0); SIZE]; PARTS];
    let (rows, _) = block.as_chunks::<SIZE>();
    let Some((biases, rows)) = rows.split_first() else {
        return [T::splat(0.0); SIZE];
    };
    for (sum, bias) in parts[0].iter_mut().zip(biases) {
        *sum = T::splat(*bias);
    }
    let (row_groups, last_rows) = rows.as_chunks::<PARTS>();
    let (value_groups, last_values) = values.as_chunks::<PARTS>();
    for (rows, values) in row_groups.iter().zip(value_groups) {
        add_products(&mut parts, rows, values);
    }
    add_products(&mut parts, last_rows, last_values);
    let [first, others @ ..] = &parts[..] else {
        return [T::splat(0.0); SIZE];
    };
    let mut sums = *first;
    for part in others {
        for (sum, value) in sums.iter_mut().zip(part) {
            *sum += *value;
        }
    }
    sums
}

/// Adds the products of one input to each part.
#[inline(always)]
fn add_products<T: Lane, const SIZE: usize>(
    parts: &mut [[T; SIZE]],
    rows: &[[f64; SIZE]],
    values: &[T],
) {
    for ((sums, row), value) in parts.iter_mut().zip(rows).zip(values) {
        for (sum, weight) in sums.iter_mut().zip(row) {
            *sum = value.mul_add(T::splat(*weight), *sum);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    #[cfg(target_arch = "x86_64")]
    use crate::simd::{Instructions, x86};
    use crate::simd::{Pack, paired};
    use proptest::prelude::*;

    /// Numbers in -1..1, the same for the same seed.
    fn numbers(seed: u64, count: usize) -> Vec<f64> {
        let mut state = seed;
        let mut next = || {
            state = state
                .wrapping_mul(0x5851_f42d_4c95_7f2d)
                .wrapping_add(0x1405_7b7e_f767_814f);
            (state >> 33) as f64 / f64::from(1_u32 << 30) - 1.0
        };
        (0..count).map(|_| next()).collect()
    }

    fn single(values: &[f64]) -> Vec<f32> {
        values.iter().map(|value| *value as f32).collect()
    }

    /// Layers of the sizes given, inputs first.
    fn layers(seed: u64, sizes: &[usize]) -> Vec<Layer> {
        sizes
            .windows(2)
            .enumerate()
            .map(|(index, pair)| {
                let seed = seed + 2 * index as u64;
                let scale = 2.0 / (pair[0] as f64).sqrt();
                let weights = numbers(seed, pair[0] * pair[1]);
                Layer {
                    weights: weights.iter().map(|w| (scale * w) as f32).collect(),
                    biases: single(&numbers(seed + 1, pair[1])),
                }
            })
            .collect()
    }

    /// The same network as its definition has it, before the rounding.
    fn reference(
        layers: &[Layer],
        activation: Activation,
        output: Output,
        observation: &[f64],
    ) -> Vec<f64> {
        let mut values = observation.to_vec();
        for (index, layer) in layers.iter().enumerate() {
            let rows = layer.weights.chunks_exact(values.len());
            let sums = rows.zip(&layer.biases).map(|(row, bias)| {
                let products = row.iter().zip(&values).map(|(w, x)| f64::from(*w) * x);
                f64::from(*bias) + products.sum::<f64>()
            });
            let finish = |sum: f64| match (index + 1 == layers.len(), activation, output) {
                (false, Activation::Tanh, _) | (true, _, Output::Tanh) => libm::tanh(sum),
                (false, Activation::Relu, _) => sum.max(0.0),
                (true, _, Output::Clip) => sum.clamp(-1.0, 1.0),
            };
            values = sums.map(finish).collect();
        }
        values
    }

    fn act(network: &Network, observation: &[f64]) -> Vec<f64> {
        let mut action = vec![0.0; network.outputs()];
        network
            .act(observation, &mut Scratch::new(), &mut action)
            .unwrap();
        action
    }

    const KINDS: [(Activation, Output); 4] = [
        (Activation::Tanh, Output::Clip),
        (Activation::Tanh, Output::Tanh),
        (Activation::Relu, Output::Clip),
        (Activation::Relu, Output::Tanh),
    ];

    proptest! {
        #[test]
        fn actions_are_those_of_the_definition(
            sizes in proptest::collection::vec(1..40_usize, 2..5),
            seed in 0..1000_u64,
        ) {
            let layers = layers(seed, &sizes);
            let observation = numbers(seed + 77, sizes[0]);
            for (activation, output) in KINDS {
                let network = Network::new(&layers, activation, output).unwrap();
                prop_assert_eq!(network.inputs(), sizes[0]);
                prop_assert_eq!(network.outputs(), sizes[sizes.len() - 1]);
                let action = act(&network, &observation);
                let expected = reference(&layers, activation, output, &observation);
                for (action, expected) in action.iter().zip(expected) {
                    prop_assert!((action - expected).abs() < 6.0e-8, "{} {}", action, expected);
                    prop_assert_eq!(f64::from(*action as f32), *action);
                }
            }
        }

        #[test]
        fn packs_compute_the_bits_of_plain_numbers(
            sizes in proptest::collection::vec(1..40_usize, 2..5),
            seed in 0..1000_u64,
        ) {
            let layers = layers(seed, &sizes);
            for (activation, output) in KINDS {
                let network = Network::new(&layers, activation, output).unwrap();
                same_bits::<Pack<8>>(&network, seed);
                same_bits::<paired::Paired<Pack<2>>>(&network, seed);
                #[cfg(target_arch = "x86_64")]
                {
                    if Instructions::detect() >= Instructions::Avx2 {
                        same_bits::<x86::Wide4>(&network, seed);
                    }
                    if Instructions::detect() >= Instructions::Avx512 {
                        same_bits::<x86::Wide8>(&network, seed);
                    }
                }
            }
        }
    }

    fn same_bits<T: Lane>(network: &Network, seed: u64) {
        let singles: Vec<Vec<f64>> = (0..T::WIDTH)
            .map(|lane| numbers(seed + 1000 * lane as u64, network.inputs()))
            .collect();
        let mut observation = vec![T::splat(0.0); network.inputs()];
        for (index, value) in observation.iter_mut().enumerate() {
            for (lane, single) in singles.iter().enumerate() {
                value.set_lane(lane, single[index]);
            }
        }
        let mut action = vec![T::splat(0.0); network.outputs()];
        network
            .act(&observation, &mut Scratch::new(), &mut action)
            .unwrap();
        for (lane, single) in singles.iter().enumerate() {
            for (action, expected) in action.iter().zip(act(network, single)) {
                assert_eq!(action.lane(lane).to_bits(), expected.to_bits());
            }
        }
    }

    fn identity(size: usize, scale: f32) -> Layer {
        let weight = |i: usize| {
            if i.is_multiple_of(size + 1) {
                scale
            } else {
                0.0
            }
        };
        Layer {
            weights: (0..size * size).map(weight).collect(),
            biases: vec![0.0; size],
        }
    }

    #[test]
    fn one_layer_is_neither_activated_nor_anything_but_clipped() {
        let network = Network::new(&[identity(3, 2.0)], Activation::Relu, Output::Clip).unwrap();
        assert_eq!(act(&network, &[0.25, -0.25, 0.0]), [0.5, -0.5, 0.0]);
        assert_eq!(act(&network, &[3.0, -3.0, 0.5]), [1.0, -1.0, 1.0]);
    }

    #[test]
    fn rows_are_outputs_and_biases_are_added() {
        let layer = Layer {
            weights: vec![0.5, 0.25, 0.125, 0.0, -0.5, 0.0],
            biases: vec![0.0, 0.25],
        };
        let network = Network::new(&[layer], Activation::Tanh, Output::Clip).unwrap();
        assert_eq!((network.inputs(), network.outputs()), (3, 2));
        assert_eq!(act(&network, &[1.0, -1.0, 2.0]), [0.5, 0.75]);
    }

    #[test]
    fn hidden_layers_lose_what_is_negative() {
        let layers = [identity(2, 1.0), identity(2, 1.0)];
        let network = Network::new(&layers, Activation::Relu, Output::Clip).unwrap();
        assert_eq!(act(&network, &[0.5, -0.5]), [0.5, 0.0]);
    }

    #[test]
    fn squashed_output_is_the_hyperbolic_tangent_in_single_precision() {
        let network = Network::new(&[identity(1, 1.0)], Activation::Relu, Output::Tanh).unwrap();
        let expected = f64::from(libm::tanh(-0.7) as f32);
        assert_eq!(act(&network, &[-0.7]), [expected]);
    }

    #[test]
    fn an_observation_that_is_not_a_number_makes_no_action() {
        for (activation, output) in KINDS {
            let network = Network::new(&layers(1, &[5, 9, 2]), activation, output).unwrap();
            let action = act(&network, &[0.1, f64::NAN, 0.3, 0.2, 0.0]);
            assert!(action.iter().all(|value| value.is_nan()));
        }
    }

    #[test]
    fn memory_is_taken_once_and_what_was_in_it_does_not_matter() {
        let network = Network::new(
            &layers(3, &[4, 7, 2, 20, 2]),
            Activation::Tanh,
            Output::Clip,
        )
        .unwrap();
        let mut scratch = Scratch::new();
        let mut action = [0.0; 2];
        network.act(&[5.0; 4], &mut scratch, &mut action).unwrap();
        let memory = |scratch: &Scratch<f64>| {
            let mut memory = [scratch.values.as_ptr(), scratch.next.as_ptr()];
            memory.sort_unstable();
            memory
        };
        let before = memory(&scratch);
        network.act(&[0.5; 4], &mut scratch, &mut action).unwrap();
        assert_eq!(memory(&scratch), before);
        assert_eq!(action[..], act(&network, &[0.5; 4]));
    }

    #[test]
    fn arrays_of_another_length_are_refused() {
        let network = Network::new(&[identity(2, 1.0)], Activation::Tanh, Output::Clip).unwrap();
        let mut scratch = Scratch::new();
        let error = network.act(&[0.0; 3], &mut scratch, &mut [0.0; 2]);
        assert_eq!(
            error.unwrap_err().to_string(),
            "observation must have length 2, got 3"
        );
        let error = network.act(&[0.0; 2], &mut scratch, &mut [0.0; 1]);
        assert_eq!(
            error.unwrap_err().to_string(),
            "action must have length 2, got 1"
        );
    }

    fn refusal(layers: &[Layer]) -> String {
        let made = Network::new(layers, Activation::Tanh, Output::Clip);
        made.unwrap_err().to_string()
    }

    #[test]
    fn layers_that_do_not_fit_are_refused_by_name() {
        let good = identity(2, 1.0);
        let with = |weights: Vec<f32>, biases: Vec<f32>| Layer { weights, biases };
        let cases = [
            (
                with(vec![0.0; 3], vec![0.0; 2]),
                "weights must hold 2 x 2 numbers, got 3",
            ),
            (
                with(vec![0.0; 6], vec![0.0; 2]),
                "weights must hold 2 x 2 numbers, got 6",
            ),
            (
                with(vec![], vec![]),
                "biases must hold 1 to 4096 numbers, got 0",
            ),
            (
                with(vec![0.0; 2 * 4097], vec![0.0; 4097]),
                "biases must hold 1 to 4096 numbers, got 4097",
            ),
            (
                with(vec![0.0, 0.0, f32::NAN, 0.0], vec![0.0; 2]),
                "weights[2] must be finite, got NaN",
            ),
            (
                with(vec![0.0; 4], vec![0.0, f32::INFINITY]),
                "biases[1] must be finite, got inf",
            ),
        ];
        for (bad, message) in cases {
            assert_eq!(
                refusal(&[good.clone(), bad]),
                format!("layers[1].{message}")
            );
        }
    }

    #[test]
    fn a_first_layer_without_whole_rows_is_refused() {
        for count in [0, 1, 5, 2 * 4097] {
            let layer = Layer {
                weights: vec![0.0; count],
                biases: vec![0.0; 2],
            };
            assert_eq!(
                refusal(&[layer]),
                format!("layers[0].weights must hold 2 rows of 1 to 4096 numbers, got {count}")
            );
        }
    }

    #[test]
    fn no_layer_and_too_many_are_refused() {
        assert_eq!(refusal(&[]), "layers must hold 1 to 64 layers, got 0");
        let many = vec![identity(1, 1.0); 65];
        assert_eq!(refusal(&many), "layers must hold 1 to 64 layers, got 65");
        assert!(Network::new(&many[1..], Activation::Tanh, Output::Clip).is_ok());
    }
}
