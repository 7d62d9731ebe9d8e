//! Random numbers from an explicit key: the same key gives the same numbers on every machine and thread count.

mod fill;
mod normal;

pub(crate) use fill::KERNEL;

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
    ///
    /// ```
    /// # use gradreel::Key;
    /// assert_eq!(Key::new(7), Key::new(7));
    /// ```
    pub fn new(seed: u64) -> Self {
        Self(mix(seed ^ 0x5851_F42D_4C95_7F2D))
    }

    /// Independent keys.
    ///
    /// ```
    /// # use gradreel::Key;
    /// let [noise, order] = Key::new(7).split();
    /// assert_ne!(noise, order);
    /// ```
    #[must_use]
    pub fn split<const N: usize>(self) -> [Self; N] {
        std::array::from_fn(|i| self.fold(i as u64))
    }

    /// The key of one member of a family: an iteration, a camera, a frame.
    ///
    /// ```
    /// # use gradreel::Key;
    /// assert_ne!(Key::new(7).fold(0), Key::new(7).fold(1));
    /// ```
    #[must_use]
    pub fn fold(self, member: u64) -> Self {
        Self(mix(self.0 ^ mix(member.wrapping_add(0xA076_1D64_78BD_642F))))
    }

    /// Uniform numbers in `[0, 1)`.
    ///
    /// ```
    /// # use gradreel::Key;
    /// assert!(Key::new(7).uniform(10).all(|x| (0.0..1.0).contains(&x)));
    /// ```
    pub fn uniform(self, count: usize) -> impl Iterator<Item = f64> {
        (0..count as u64).map(move |i| (self.bits(i) >> 11) as f64 * (1.0 / (1u64 << 53) as f64))
    }

    /// Numbers of the standard normal distribution: its quantile function (Wichura 1988) at uniform numbers. The same ones
    /// for every thread count; between platforms they may differ in the last places, as the logarithm does.
    ///
    /// ```
    /// use gradreel::Key;
    ///
    /// let x: Vec<f64> = Key::new(7).normal(10_000).collect();
    /// let mean = x.iter().sum::<f64>() / x.len() as f64;
    /// assert!(mean.abs() < 0.03);
    /// ```
    pub fn normal(self, count: usize) -> impl Iterator<Item = f64> {
        const BLOCK: usize = 256;
        (0..count.div_ceil(BLOCK)).flat_map(move |block| {
            let start = block * BLOCK;
            let mut values = vec![0.0; BLOCK.min(count - start)];
            normal::fill(self, start as u64, &mut values);
            values
        })
    }

    /// Uniform integers in `0..bound`.
    ///
    /// ```
    /// # use gradreel::Key;
    /// assert!(Key::new(7).below(6, 10).all(|x| x < 6));
    /// ```
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
    fn normal_numbers_have_the_right_moments_and_tails() {
        let n = 200_000;
        let x: Vec<f64> = Key::new(5).normal(n).collect();
        let moment = |p: i32| x.iter().map(|v| v.powi(p)).sum::<f64>() / n as f64;
        assert!(moment(1).abs() < 0.01 && (moment(2) - 1.0).abs() < 0.02, "{} {}", moment(1), moment(2));
        assert!(moment(3).abs() < 0.05 && (moment(4) - 3.0).abs() < 0.1, "{} {}", moment(3), moment(4));
        let beyond = |z: f64| x.iter().filter(|v| v.abs() > z).count() as f64 / n as f64;
        assert!((beyond(1.959_964) - 0.05).abs() < 2e-3 && (beyond(3.290_527) - 1e-3).abs() < 3e-4);
    }

    #[test]
    fn bounded_integers_cover_their_range() {
        let mut seen = [0usize; 7];
        Key::new(3).below(7, 7000).for_each(|i| seen[i] += 1);
        assert!(seen.iter().all(|&count| (800..1200).contains(&count)), "{seen:?}");
    }
}
