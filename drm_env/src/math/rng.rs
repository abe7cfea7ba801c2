//! Random streams: a function of (seed, episode, purpose), the same on every platform and whatever
//! the order in which environments are stepped. Uniforms and normals are taken from raw bits here,
//! so that no change of a dependency's distributions moves a recorded run.

use rand::Rng;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// A seed of any size, reduced to 256 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Seed([u64; 4]);

/// What a stream is used for; streams of one episode do not overlap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// Drawing one scenario parameter, by its flat name: drawing one more moves no other.
    Parameter(&'static str),
    /// Sensor noise.
    Sensors,
}

/// The finaliser of SplitMix64 (Steele, Lea, Flood 2014).
fn mixed(mut z: u64) -> u64 {
    z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Seed {
    /// From the little-endian bytes of a non-negative integer; leading zeros do not matter.
    pub fn from_le_bytes(bytes: &[u8]) -> Self {
        let used = bytes.len() - bytes.iter().rev().take_while(|&&b| b == 0).count();
        let mut words = [1, 2, 3, 4].map(mixed);
        for chunk in bytes[..used].chunks(8) {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            absorb(&mut words, u64::from_le_bytes(word));
        }
        absorb(&mut words, used.div_ceil(8) as u64);
        Self(words)
    }

    /// From a small integer; equal to [`Seed::from_le_bytes`] of the same number.
    pub fn from_u64(seed: u64) -> Self {
        Self::from_le_bytes(&seed.to_le_bytes())
    }
}

fn absorb(words: &mut [u64; 4], word: u64) {
    let mut carry = word;
    for value in words.iter_mut() {
        carry = mixed(*value ^ carry);
        *value = carry;
    }
}

/// A stream of random numbers.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stream(Pcg64);

impl Stream {
    /// The stream of one episode of a seed for one purpose.
    pub fn new(seed: Seed, episode: u64, purpose: Purpose) -> Self {
        Self::of_attempt(seed, episode, purpose, 0)
    }

    /// The stream for another attempt at what the first one, attempt 0, has not achieved.
    pub fn of_attempt(seed: Seed, episode: u64, purpose: Purpose, attempt: u64) -> Self {
        let mut words = seed.0;
        absorb(&mut words, episode);
        match purpose {
            Purpose::Sensors => absorb(&mut words, 0),
            Purpose::Parameter(name) => {
                absorb(&mut words, 1 + u64::from(crc32fast::hash(name.as_bytes())));
            }
        }
        if attempt > 0 {
            absorb(&mut words, attempt);
        }
        let wide = |high: u64, low: u64| (u128::from(high) << 64) | u128::from(low);
        Self(Pcg64::new(
            wide(words[0], words[1]),
            wide(words[2], words[3]),
        ))
    }

    /// Another stream of the same seed, episode and purpose, `which` of some.
    #[must_use]
    pub(crate) fn beside(&self, which: u64) -> Self {
        let words: [u64; 2] = [0x7469_705f_6779_726f, 0x6265_7369_6465_2121];
        let [high, low] = words.map(|word| mixed(word ^ which));
        let other = (u128::from(high) << 64) | u128::from(low);
        let (state, increment) = self.words().unwrap_or_default();
        Self(Pcg64::new(state ^ other, (increment >> 1) ^ other))
    }

    /// State and increment.
    fn words(&self) -> Option<(u128, u128)> {
        let bytes = postcard::to_allocvec(self).ok()?;
        postcard::from_bytes(&bytes).ok()
    }

    /// What tells the streams of seeds, episodes and purposes apart at any time: their increments.
    pub(crate) fn track(&self) -> Option<u128> {
        self.words().map(|(_state, increment)| increment)
    }

    /// Uniform on [0, 1): the upper 53 bits of a word.
    pub fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// Standard normal, by Box and Muller's transformation (one value of each pair).
    pub fn normal(&mut self) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.uniform()));
        radius * libm::cos(std::f64::consts::TAU * self.uniform())
    }

    /// Uniform integer in 0..count.
    pub fn index(&mut self, count: usize) -> usize {
        // the bias of 2^-53 count is far below anything a draw can show
        ((self.uniform() * count as f64) as usize).min(count.saturating_sub(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_values_of_a_seed_never_change() {
        let mut stream = Stream::new(Seed::from_u64(2024), 3, Purpose::Parameter("payload_mass"));
        let first: Vec<u64> = (0..2).map(|_| stream.uniform().to_bits()).collect();
        let mut again = Stream::new(
            Seed::from_le_bytes(&[0xe8, 7]),
            3,
            Purpose::Parameter("payload_mass"),
        );
        assert_eq!(first[0], again.uniform().to_bits());
        assert_ne!(first[0], first[1]);
    }

    #[test]
    fn seeds_episodes_purposes_and_attempts_have_streams_of_their_own() {
        let mut seen = std::collections::HashSet::new();
        for seed in 0..50 {
            for episode in 0..10 {
                for purpose in [
                    Purpose::Parameter("payload_mass"),
                    Purpose::Parameter("mass_error"),
                    Purpose::Sensors,
                ] {
                    for attempt in 0..3 {
                        let seed = Seed::from_u64(seed);
                        let mut stream = Stream::of_attempt(seed, episode, purpose, attempt);
                        assert!(seen.insert(stream.uniform().to_bits()));
                    }
                }
            }
        }
        let wide = [1_u8; 40];
        assert_ne!(Seed::from_le_bytes(&wide), Seed::from_le_bytes(&wide[..39]));
    }

    #[test]
    fn moments_of_uniform_and_normal() {
        let mut stream = Stream::new(Seed::from_u64(1), 0, Purpose::Sensors);
        let n = 200_000;
        let (mut mean, mut square, mut uniform) = (0.0, 0.0, 0.0);
        for _ in 0..n {
            let z = stream.normal();
            mean += z / f64::from(n);
            square += z * z / f64::from(n);
            uniform += stream.uniform() / f64::from(n);
        }
        assert!(mean.abs() < 0.01 && (square - 1.0).abs() < 0.02);
        assert!((uniform - 0.5).abs() < 0.005);
    }
}
