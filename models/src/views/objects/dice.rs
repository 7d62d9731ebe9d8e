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
    /// A number of the standard normal distribution.
    pub fn normal(&mut self) -> f64 {
        self.next().normal(1).next().expect("one number")
    }

    /// Numbers of the standard normal distribution.
    pub fn normals(&mut self, count: usize) -> impl Iterator<Item = f64> {
        self.next().normal(count)
    }

    /// Numbers uniform in 0..1.
    pub fn uniforms(&mut self, count: usize) -> impl Iterator<Item = f64> {
        self.next().uniform(count)
    }

    /// A rotation, uniform over all of them (Shoemake, *Uniform random rotations*, 1992).
    pub fn turn(&mut self) -> [[f64; 3]; 3] {
        let [u, a, b] = [1.0, std::f64::consts::TAU, std::f64::consts::TAU].map(|most| self.within(0.0, most));
        let (r, s) = ((1.0 - u).sqrt(), u.sqrt());
        let [x, y, z, w] = [r * a.sin(), r * a.cos(), s * b.sin(), s * b.cos()];
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    }
}
