//! The state of a substep: position, velocity, affine velocity and deformation gradient of every particle.

use super::row::Number;
use gradreel::{Error, ErrorKind, Result};

/// Particles per block.
///
/// A block stores one array of this length per component, so that a material program runs over whole arrays and a block
/// (24 KiB in `f32`) stays in the L1 cache.
pub const BLOCK: usize = 256;

/// Components per particle before history variables: position 3, velocity 3, affine velocity 9, deformation gradient 9.
pub(crate) const COMPONENTS: usize = 24;
/// First component of the velocity.
pub(crate) const V: usize = 3;
/// First component of the affine velocity, row by row.
pub(crate) const C: usize = 6;
/// First component of the deformation gradient, row by row.
pub(crate) const F: usize = 15;
/// First component of the history variables.
pub(crate) const HISTORY: usize = COMPONENTS;

/// The state of all particles between two substeps, or the cotangent of one.
///
/// | part | shape | unit | what |
/// |---|---|---|---|
/// | `x` | `[n, 3]` | m | position |
/// | `v` | `[n, 3]` | m/s | velocity |
/// | `c` | `[n, 3, 3]` | 1/s | affine velocity, about the velocity gradient |
/// | `f` | `[n, 3, 3]` | - | deformation gradient |
///
/// Particles of a material with history variables carry those as well; see [`State::with_history`].
///
/// ```
/// use gradreel_models::physics::State;
///
/// let state = State::at_rest(&[[0.1_f64, 0.2, 0.3]], &[[0.0, -1.0, 0.0]])?;
/// assert_eq!(state.len(), 1);
/// assert_eq!(state.positions(), vec![[0.1, 0.2, 0.3]]);
/// assert_eq!(state.deformation_gradients()[0], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct State<T> {
    /// Blocks of [`COMPONENTS`] arrays of [`BLOCK`] values, plus one array per history variable.
    pub(crate) values: Vec<T>,
    history: usize,
    /// Lowest and highest coordinate per axis \[m\].
    pub(crate) extent: [[T; 3]; 2],
    len: usize,
}

impl<T: Number> State<T> {
    /// Undeformed particles (`f = I`, `c = 0`) at these positions \[m\] with these velocities \[m/s\].
    ///
    /// # Errors
    ///
    /// [`ErrorKind::NonFinite`] naming the first particle with a non-finite value.
    ///
    /// # Panics
    ///
    /// If the two lists differ in length.
    #[track_caller]
    pub fn at_rest(positions: &[[T; 3]], velocities: &[[T; 3]]) -> Result<Self> {
        let (zero, one) = (T::ZERO, T::ONE);
        let identity = [[one, zero, zero], [zero, one, zero], [zero, zero, one]];
        let len = positions.len();
        Self::new(positions, velocities, &vec![[[zero; 3]; 3]; len], &vec![identity; len])
    }

    /// Particles in any state: positions \[m\], velocities \[m/s\], affine velocities \[1/s\], deformation gradients.
    ///
    /// # Errors
    ///
    /// As for [`State::at_rest`].
    ///
    /// # Panics
    ///
    /// If the lists differ in length.
    #[track_caller]
    pub fn new(x: &[[T; 3]], v: &[[T; 3]], c: &[[[T; 3]; 3]], f: &[[[T; 3]; 3]]) -> Result<Self> {
        let len = x.len();
        let lens = [v.len(), c.len(), f.len()];
        assert!(lens == [len; 3], "state: {len} positions, but {lens:?} velocities, affine velocities and gradients");
        let mut state = Self::zeros(len);
        state.extent = x.first().map_or([[T::ZERO; 3]; 2], |&x| [x, x]);
        for p in 0..len {
            let matrices = c[p].as_flattened().iter().chain(f[p].as_flattened());
            for (component, &value) in x[p].iter().chain(&v[p]).chain(matrices).enumerate() {
                if !value.is_finite() {
                    return Err(non_finite(p, component, value));
                }
                let at = state.index(p, component);
                state.values[at] = value;
            }
            state.extent = widen(state.extent, x[p]);
        }
        Ok(state)
    }

    /// All zero, without history: an initial cotangent.
    pub fn zeros(len: usize) -> Self {
        Self::zeros_with_history(len, 0)
    }

    /// All zero, with the same number of particles and history variables.
    #[must_use]
    pub fn zeros_like(&self) -> Self {
        Self::zeros_with_history(self.len, self.history)
    }

    /// All zero, with `history` variables per particle.
    pub(crate) fn zeros_with_history(len: usize, history: usize) -> Self {
        let values = vec![T::ZERO; len.div_ceil(BLOCK) * (COMPONENTS + history) * BLOCK];
        Self { values, history, extent: [[T::ZERO; 3]; 2], len }
    }

    /// The same state with these history variables, replacing previous ones; each list has one value per particle.
    ///
    /// ```
    /// use gradreel_models::physics::State;
    ///
    /// let state = State::at_rest(&[[0.0_f64; 3]; 2], &[[0.0; 3]; 2])?.with_history(&[vec![1.0, 0.9]]);
    /// assert_eq!(state.history(0), [1.0, 0.9]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    ///
    /// If a list has another length.
    #[must_use]
    #[track_caller]
    pub fn with_history(self, variables: &[Vec<T>]) -> Self {
        let mut state = Self::zeros_with_history(self.len, variables.len());
        state.extent = self.extent;
        let blocks = self
            .values
            .chunks_exact(self.stride())
            .zip(state.values.chunks_exact_mut(variables.len() * BLOCK + COMPONENTS * BLOCK));
        blocks.for_each(|(from, to)| to[..COMPONENTS * BLOCK].copy_from_slice(&from[..COMPONENTS * BLOCK]));
        for (k, values) in variables.iter().enumerate() {
            assert!(values.len() == self.len, "history: {} values for {} particles", values.len(), self.len);
            for (p, &value) in values.iter().enumerate() {
                let at = state.index(p, HISTORY + k);
                state.values[at] = value;
            }
        }
        state
    }

    /// A history variable of all particles, in the order in which its material declares them.
    ///
    /// # Panics
    ///
    /// If the state has fewer.
    #[track_caller]
    pub fn history(&self, variable: usize) -> Vec<T> {
        assert!(variable < self.history, "history: variable {variable} of {}", self.history);
        (0..self.len).map(|p| self.values[self.index(p, HISTORY + variable)]).collect()
    }

    /// Number of history variables per particle.
    pub(crate) fn history_count(&self) -> usize {
        self.history
    }

    /// Values per block of particles.
    pub(crate) fn stride(&self) -> usize {
        (COMPONENTS + self.history) * BLOCK
    }

    /// Number of particles.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are no particles.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Positions \[m\].
    pub fn positions(&self) -> Vec<[T; 3]> {
        (0..self.len).map(|p| self.read(p, 0)).collect()
    }

    /// Velocities \[m/s\].
    pub fn velocities(&self) -> Vec<[T; 3]> {
        (0..self.len).map(|p| self.read(p, V)).collect()
    }

    /// Affine velocities \[1/s\].
    pub fn affine_velocities(&self) -> Vec<[[T; 3]; 3]> {
        (0..self.len).map(|p| std::array::from_fn(|row| self.read(p, C + 3 * row))).collect()
    }

    /// Deformation gradients.
    pub fn deformation_gradients(&self) -> Vec<[[T; 3]; 3]> {
        (0..self.len).map(|p| std::array::from_fn(|row| self.read(p, F + 3 * row))).collect()
    }

    /// Size of the values \[bytes\].
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.values[..])
    }

    /// One component of all particles.
    pub(crate) fn component(&self, component: usize) -> Vec<T> {
        (0..self.len).map(|p| self.values[self.index(p, component)]).collect()
    }

    /// A state from all components, one list after the other; non-finite values are accepted.
    pub(crate) fn of_components(len: usize, history: usize, values: &[T]) -> Self {
        let mut state = Self::zeros_with_history(len, history);
        for (at, &value) in values.iter().take(len * (COMPONENTS + history)).enumerate() {
            let slot = state.index(at % len, at / len);
            state.values[slot] = value;
        }
        if len > 0 {
            state.extent = (0..len).map(|p| state.read(p, 0)).fold([state.read(0, 0); 2], widen);
        }
        state
    }

    /// Adds to the position of a particle; used for the cotangents of a frame.
    pub(crate) fn add_to_position(&mut self, particle: usize, value: [T; 3]) {
        for (axis, value) in value.into_iter().enumerate() {
            let at = self.index(particle, axis);
            self.values[at] += value;
        }
    }

    /// Sets the affine velocity of a particle.
    pub(crate) fn set_affine_velocity(&mut self, particle: usize, c: [[T; 3]; 3]) {
        c.into_iter().enumerate().for_each(|(row, values)| self.write(particle, C + 3 * row, values));
    }

    /// All components of all particles, particle by particle.
    pub(crate) fn numbers(&self) -> Vec<f64> {
        let each = (0..self.len).flat_map(|p| (0..COMPONENTS + self.history).map(move |k| (p, k)));
        each.map(|(p, k)| self.values[self.index(p, k)].to_f64()).collect()
    }

    /// Restores the values that [`State::numbers`] of a state of the same size returned.
    pub(crate) fn restore(&mut self, numbers: &[f64]) -> Result<()> {
        let width = COMPONENTS + self.history;
        if numbers.len() != self.len * width || numbers.iter().any(|x| !x.is_finite()) {
            return Err(Error::new(ErrorKind::Input, "the saved state does not belong to this scene, or is damaged")
                .found(format!("{} numbers", numbers.len()))
                .wanted(format!("{} finite ones, {width} for each of {} particles", self.len * width, self.len)));
        }
        for (at, &value) in numbers.iter().enumerate() {
            let slot = self.index(at / width, at % width);
            self.values[slot] = T::from_f64(value);
        }
        if self.len > 0 {
            self.extent = (0..self.len).map(|p| self.read(p, 0)).fold([self.read(0, 0); 2], widen);
        }
        Ok(())
    }

    /// Sets three values from a component on.
    pub(crate) fn write(&mut self, particle: usize, component: usize, value: [T; 3]) {
        for (axis, value) in value.into_iter().enumerate() {
            let at = self.index(particle, component + axis);
            self.values[at] = value;
        }
    }

    /// Three values from a component on.
    pub(crate) fn read(&self, particle: usize, component: usize) -> [T; 3] {
        std::array::from_fn(|i| self.values[self.index(particle, component + i)])
    }

    /// The index in `values` of a component of a particle.
    fn index(&self, particle: usize, component: usize) -> usize {
        (particle / BLOCK * (COMPONENTS + self.history) + component) * BLOCK + particle % BLOCK
    }
}

/// The box extended to contain `x`.
#[inline(always)]
pub(crate) fn widen<T: Number>([mut low, mut high]: [[T; 3]; 2], x: [T; 3]) -> [[T; 3]; 2] {
    for axis in 0..3 {
        if x[axis] < low[axis] {
            low[axis] = x[axis];
        }
        if x[axis] > high[axis] {
            high[axis] = x[axis];
        }
    }
    [low, high]
}

fn non_finite<T: Number>(particle: usize, component: usize, value: T) -> Error {
    let name = match component {
        ..V => "position",
        V..C => "velocity",
        C..F => "affine velocity",
        _ => "deformation gradient",
    };
    Error::new(ErrorKind::NonFinite, format!("a particle starts with a non-finite {name}"))
        .at(format!("particle {particle}"))
        .found(value)
        .wanted("finite numbers")
}
