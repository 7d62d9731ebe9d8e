//! Random numbers from an explicit key: the same key gives the same numbers on every machine and thread count.

/// A splittable key. Nothing in the crate reads a clock or a global generator.
///
/// Numbers come from the SplitMix64 mixing function (Steele, Lea, Flood 2014) applied to a counter.
///
/// ```
/// use gradreel::Key;
///
/// let [pixels, jitter] = Key::new(7).split();
/// assert_ne!(pixels.uniform(1).next(), jitter.uniform(1).next());
/// assert_eq!(pixels.uniform(3).collect::<Vec<_>>(), pixels.uniform(3).collect::<Vec<_>>());
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Key(u64);

impl Key {
    /// A key from a seed.
    pub fn new(seed: u64) -> Self {
        Self(mix(seed ^ 0x5851_F42D_4C95_7F2D))
    }

    /// Independent keys.
    #[must_use]
    pub fn split<const N: usize>(self) -> [Self; N] {
        std::array::from_fn(|i| self.fold(i as u64))
    }

    /// The key of one member of a family: an iteration, a camera, a frame.
    #[must_use]
    pub fn fold(self, member: u64) -> Self {
        Self(mix(self.0 ^ mix(member.wrapping_add(0xA076_1D64_78BD_642F))))
    }

    /// Uniform numbers in `[0, 1)`.
    pub fn uniform(self, count: usize) -> impl Iterator<Item = f64> {
        (0..count as u64).map(move |i| (self.bits(i) >> 11) as f64 * (1.0 / (1u64 << 53) as f64))
    }

    /// Uniform integers in `0..bound`.
    ///
    /// # Panics
    /// When `bound` is 0.
    #[track_caller]
    pub fn below(self, bound: usize, count: usize) -> impl Iterator<Item = usize> {
        assert!(bound > 0, "below: there is no integer below 0");
        (0..count as u64).map(move |i| ((u128::from(self.bits(i)) * bound as u128) >> 64) as usize)
    }

    fn bits(self, counter: u64) -> u64 {
        mix(self.0.wrapping_add(counter.wrapping_mul(0x9E37_79B9_7F4A_7C15)))
    }
}

fn mix(mut z: u64) -> u64 {
    z = z.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_numbers_have_the_right_moments() {
        let n = 100_000;
        let x: Vec<f64> = Key::new(1).uniform(n).collect();
        let mean = x.iter().sum::<f64>() / n as f64;
        let variance = x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n as f64;
        assert!((mean - 0.5).abs() < 5e-3 && (variance - 1.0 / 12.0).abs() < 2e-3);
        assert!(x.iter().all(|v| (0.0..1.0).contains(v)));
    }

    #[test]
    fn bounded_integers_cover_their_range() {
        let mut seen = [0usize; 7];
        Key::new(3).below(7, 7000).for_each(|i| seen[i] += 1);
        assert!(seen.iter().all(|&count| (800..1200).contains(&count)), "{seen:?}");
    }
}
