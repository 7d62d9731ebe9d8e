//! A sequence of random numbers from a key.

use gradreel::Key;

/// A key, and the count of numbers drawn from it.
pub(crate) struct Dice {
    key: Key,
    thrown: u64,
}

impl Dice {
    pub fn new(key: Key) -> Self {
        Self { key, thrown: 0 }
    }

    fn next(&mut self) -> Key {
        self.thrown += 1;
        self.key.fold(self.thrown)
    }

    /// Uniform in a range.
    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next().uniform(1).next().expect("one number")
    }

    /// Uniform integer below `count`.
    pub fn below(&mut self, count: usize) -> usize {
        self.next().below(count, 1).next().expect("one number")
    }

    /// True with this probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.within(0.0, 1.0) < probability
    }

    /// Three numbers, uniform in the same range.
    pub fn three(&mut self, low: f64, high: f64) -> [f64; 3] {
        [0; 3].map(|_| self.within(low, high))
    }

    /// A unit vector, uniform on the sphere.
    pub fn direction(&mut self) -> [f64; 3] {
        let (up, around) = (self.within(-1.0, 1.0), self.within(0.0, std::f64::consts::TAU));
        let wide = (1.0 - up * up).max(0.0).sqrt();
        [wide * around.cos(), wide * around.sin(), up]
    }
}
