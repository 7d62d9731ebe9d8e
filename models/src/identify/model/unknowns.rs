//! The unknowns of an estimate: velocity, spin and material parameters in the unconstrained form that an optimiser moves.

use gradreel::{DType, Error, ErrorKind, Result, Tape, Tensor, Var};
use serde::{Deserialize, Serialize};

use crate::physics::{Law, Map, Parameter};

/// One unit of the optimiser's velocity coordinates \[m/s\], so that a unit step is of similar effect in all unknowns.
const SPEED: f64 = 0.1;

/// One unit of its coordinates of the spin \[rad/s\]: a decimetre from its centre a body is then as fast as that.
const TURNING: f64 = 1.0;

/// One unit of the optimiser's coordinate of a parameter, in its unconstrained form: a decade of a magnitude, and three of
/// Poisson's ratio, which moves particles less (the curvatures of the loss along the ratio and along a modulus differ by a
/// factor of about ten).
pub(crate) fn unit(parameter: &Parameter) -> f64 {
    match parameter.map {
        Map::Log10 => 1.0,
        Map::Linear => parameter.prior[1] - parameter.prior[0],
        // three for Poisson's ratio, whose plausible range is 0.45; as much more for a wider one
        Map::Bounded { .. } => (parameter.prior[1] - parameter.prior[0]) / 0.15,
    }
}

/// Names of the velocity's components, beside those of parameters.
pub const VELOCITY: [&str; 3] = ["velocity_x", "velocity_y", "velocity_z"];

/// Names of the spin's components.
pub const SPIN: [&str; 3] = ["spin_x", "spin_y", "spin_z"];

/// Names of the components of the depth modes.
pub(in crate::identify) const DEPTH: [&str; 4] = ["depth_shear_right", "depth_shear_up", "depth_scale", "pitch"];

/// Name of the coefficient of friction of the ground.
pub const FRICTION: &str = "ground_friction";

/// Velocity \[m/s\], spin \[rad/s\] and material parameters (SI units).
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct Unknowns {
    /// Initial velocity of the whole object, of its centre of mass if it spins \[m/s\].
    pub velocity: [f64; 3],
    /// Initial angular velocity about the centre of mass \[rad/s\].
    #[serde(default)]
    pub spin: [f64; 3],
    /// The material's parameters in their order.
    pub parameters: Vec<f64>,
    /// How much higher than it is the ground is felt, in grid spacings: a grid stops a body a share of a cell above the
    /// ground, and a coarse one earlier than a fine one or the real ground.
    #[serde(default)]
    pub contact: f64,
    /// Coefficient of Coulomb friction of the ground, where it has friction.
    #[serde(default)]
    pub friction: f64,
    /// How otherwise than it was taken to a body lies that a single camera saw: how much deeper, in metres for each metre to the right,
    /// upwards, and of its distance; and how much further down the camera looks \[rad\].
    #[serde(default)]
    pub depth: [f64; 4],
}

/// The coordinate of the unknown of this name at a value in its unit, and how fast it changes with the value.
pub(crate) fn coordinate(law: &Law, name: &str, value: f64) -> Option<(f64, f64)> {
    if VELOCITY.contains(&name) {
        return Some((value / SPEED, 1.0 / SPEED));
    }
    if SPIN.contains(&name) {
        return Some((value / TURNING, 1.0 / TURNING));
    }
    if name == FRICTION {
        return (value > 0.0).then(|| (value.log10(), 1.0 / (std::f64::consts::LN_10 * value)));
    }
    let parameter = law.parameters().iter().find(|p| p.name == name)?;
    let raw = parameter.map.raw(value);
    let slope = 1.0 / (parameter.map.derivative(raw) * unit(parameter));
    raw.is_finite().then(|| (raw / unit(parameter), slope))
}

/// Least coefficient of friction that has a logarithm.
const LEAST_FRICTION: f64 = 1e-6;

/// Which unknowns an optimiser moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Free {
    /// The velocity only.
    Velocity,
    /// The material's parameters that are known to an order of magnitude only: those fitted as logarithms.
    Magnitudes,
    /// All parameters of the material.
    Material,
    /// Velocity and material.
    Both,
    /// One by one.
    Chosen(Chosen),
}

/// What is free, one by one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Chosen {
    /// Whether the velocity is free.
    pub velocity: bool,
    /// Whether the spin is.
    pub spin: bool,
    /// Bit `k` says whether parameter `k` is; parameters beyond the 64th are held.
    pub parameters: u64,
    /// Whether the height at which the ground is felt is.
    pub contact: Ground,
    /// Whether the friction of the ground is.
    #[serde(default)]
    pub friction: bool,
    /// Whether the depth shear of the body to the right and upwards is.
    pub depth: bool,
    /// Whether its distance is.
    pub distance: bool,
    /// Whether the pitch of the camera is.
    #[serde(default)]
    pub pitch: bool,
}

/// What is known of the height at which the ground is felt.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Ground {
    /// It stays as it is.
    Held,
    /// The ground's height is known, and it is felt within about half a grid spacing of it.
    Known,
    /// The ground's height is uncertain itself, by a grid spacing or so: a single camera saw it.
    Unsure,
}

impl Ground {
    /// The plausible range \[grid spacings\].
    pub fn range(self) -> [f64; 2] {
        match self {
            Self::Held => [0.0; 2],
            Self::Known => [-0.6, 0.6],
            Self::Unsure => [-1.5, 1.5],
        }
    }
}

/// One free unknown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unknown {
    /// A component of the velocity.
    Velocity(usize),
    /// A component of the spin.
    Spin(usize),
    /// A parameter of the material.
    Parameter(usize),
    /// The height at which the ground is felt.
    Contact,
    /// The coefficient of friction of the ground, as a decimal logarithm.
    Friction,
    /// A depth mode: the shear to the right and upwards, the scale of the distance, or the camera's pitch.
    Depth(usize),
}

impl Unknown {
    /// The distance of what a single camera saw.
    pub const DISTANCE: Self = Self::Depth(2);

    /// The pitch of a single camera.
    pub const PITCH: Self = Self::Depth(3);

    /// Its name in results.
    pub fn name(self, law: &Law) -> String {
        match self {
            Self::Velocity(axis) => VELOCITY[axis].to_owned(),
            Self::Spin(axis) => SPIN[axis].to_owned(),
            Self::Parameter(k) => law.parameters()[k].name.to_owned(),
            Self::Contact => "contact".to_owned(),
            Self::Friction => FRICTION.to_owned(),
            Self::Depth(axis) => DEPTH[axis].to_owned(),
        }
    }

    /// Its value, in its own unit.
    pub fn of(self, unknowns: &Unknowns) -> f64 {
        match self {
            Self::Velocity(axis) => unknowns.velocity[axis],
            Self::Spin(axis) => unknowns.spin[axis],
            Self::Parameter(k) => unknowns.parameters[k],
            Self::Contact => unknowns.contact,
            Self::Friction => unknowns.friction,
            Self::Depth(axis) => unknowns.depth[axis],
        }
    }
}

/// Nothing is free.
const NONE: Chosen = Chosen {
    velocity: false,
    spin: false,
    parameters: 0,
    contact: Ground::Held,
    friction: false,
    depth: false,
    distance: false,
    pitch: false,
};

impl Free {
    /// Nothing.
    pub const NOTHING: Self = Self::Chosen(NONE);

    fn velocity(self) -> bool {
        matches!(self, Self::Velocity | Self::Both | Self::Chosen(Chosen { velocity: true, .. }))
    }

    fn spin(self) -> bool {
        matches!(self, Self::Chosen(Chosen { spin: true, .. }))
    }

    fn parameter(self, index: usize, map: Map) -> bool {
        match self {
            Self::Velocity => false,
            Self::Magnitudes => map == Map::Log10,
            Self::Material | Self::Both => true,
            Self::Chosen(Chosen { parameters, .. }) => index < 64 && parameters >> index & 1 == 1,
        }
    }

    /// All parameters of a law but those held; with `world` also the velocity and the height at which the ground is felt.
    pub fn all_but(law: &Law, held: &[&str], world: bool) -> Self {
        let free = law.parameters().iter().enumerate().take(64).filter(|(_, p)| !held.contains(&p.name));
        let ground = if world { Ground::Known } else { Ground::Held };
        let parameters = free.map(|(k, _)| 1 << k).sum();
        Self::Chosen(Chosen { velocity: world, parameters, contact: ground, ..NONE })
    }

    /// The same with the velocity.
    #[must_use]
    pub fn with_velocity(self, law: &Law) -> Self {
        Self::Chosen(Chosen { velocity: true, ..self.chosen(law) })
    }

    /// The same with the spin, if it may have one.
    #[must_use]
    pub fn with_spin(self, law: &Law, spin: bool) -> Self {
        Self::Chosen(Chosen { spin: spin || self.spin(), ..self.chosen(law) })
    }

    /// The same with this height at which the ground is felt.
    #[must_use]
    pub fn with_ground(self, law: &Law, contact: Ground) -> Self {
        Self::Chosen(Chosen { contact, ..self.chosen(law) })
    }

    /// The same with the friction of the ground.
    #[must_use]
    pub fn with_friction(self, law: &Law) -> Self {
        Self::Chosen(Chosen { friction: true, ..self.chosen(law) })
    }

    /// The same with the depth shear of the body.
    #[must_use]
    pub fn with_depth_shear(self, law: &Law) -> Self {
        Self::Chosen(Chosen { depth: true, ..self.chosen(law) })
    }

    /// The same with the distance of the body.
    #[must_use]
    pub fn with_distance(self, law: &Law) -> Self {
        Self::Chosen(Chosen { distance: true, ..self.chosen(law) })
    }

    /// The same with the pitch of the camera.
    #[must_use]
    pub fn with_pitch(self, law: &Law) -> Self {
        Self::Chosen(Chosen { pitch: true, ..self.chosen(law) })
    }

    /// The same, one by one.
    fn chosen(self, law: &Law) -> Chosen {
        let free = law.parameters().iter().enumerate().take(64).filter(|(k, p)| self.parameter(*k, p.map));
        let parameters = free.map(|(k, _)| 1 << k).sum();
        let (velocity, spin, contact) = (self.velocity(), self.spin(), self.contact());
        Chosen {
            velocity,
            spin,
            parameters,
            contact,
            friction: self.friction(),
            depth: self.depth(),
            distance: self.distance(),
            pitch: self.pitch(),
        }
    }

    /// What is known of the height at which the ground is felt.
    pub fn contact(self) -> Ground {
        match self {
            Self::Chosen(Chosen { contact, .. }) => contact,
            _ => Ground::Held,
        }
    }

    fn friction(self) -> bool {
        matches!(self, Self::Chosen(Chosen { friction: true, .. }))
    }

    fn depth(self) -> bool {
        matches!(self, Self::Chosen(Chosen { depth: true, .. }))
    }

    /// Whether the distance is free.
    pub fn distance(self) -> bool {
        matches!(self, Self::Chosen(Chosen { distance: true, .. }))
    }

    /// Whether the camera's pitch is free.
    pub fn pitch(self) -> bool {
        matches!(self, Self::Chosen(Chosen { pitch: true, .. }))
    }

    /// The free unknowns in the order of their coordinates.
    pub fn list(self, law: &Law) -> Vec<Unknown> {
        let velocity = (0..3).filter(|_| self.velocity()).map(Unknown::Velocity);
        let spin = (0..3).filter(|_| self.spin()).map(Unknown::Spin);
        let parameters = law.parameters().iter().enumerate().filter(|(k, p)| self.parameter(*k, p.map));
        let contact = (self.contact() != Ground::Held).then_some(Unknown::Contact);
        let friction = self.friction().then_some(Unknown::Friction);
        let depth = (0..2).filter(|_| self.depth()).map(Unknown::Depth);
        let distance = self.distance().then_some(Unknown::DISTANCE);
        let body = contact
            .into_iter()
            .chain(friction)
            .chain(depth)
            .chain(distance)
            .chain(self.pitch().then_some(Unknown::PITCH));
        velocity.chain(spin).chain(parameters.map(|(k, _)| Unknown::Parameter(k))).chain(body).collect()
    }
}

/// The unknowns as variables: leaves in unconstrained form, and the physical values that follow from them on the tape.
pub struct Bound {
    leaves: Vec<Var>,
    /// The spin's values, and whether it is a leaf.
    turning: ([f64; 3], bool),
    /// Velocity `[3]` \[m/s\].
    pub velocity: Var,
    /// Spin `[3]` \[rad/s\], if there is one or it is free.
    pub spin: Option<Var>,
    /// Each parameter as `[1]`, in SI units.
    pub parameters: Vec<Var>,
    /// The coefficient of friction of the ground, `[1]`.
    pub friction: Var,
    /// How much higher than it is the ground is felt, in grid spacings; never a leaf.
    pub contact: f64,
    /// The depth modes; never leaves.
    pub depth: [f64; 4],
}

impl Unknowns {
    /// Depth shear to the right and upwards \[m/m\], depth scale, a share of the distance, and how much further down than it was taken
    /// to the camera looks \[rad\]: the modes of what a single camera saw.
    pub fn depth_modes(&self) -> [f64; 4] {
        self.depth
    }

    /// The coordinates of the free unknowns.
    pub fn coordinates(&self, law: &Law, free: Free) -> Vec<f64> {
        let coordinate = |unknown| match unknown {
            Unknown::Velocity(axis) => self.velocity[axis] / SPEED,
            Unknown::Spin(axis) => self.spin[axis] / TURNING,
            Unknown::Parameter(k) => {
                let p = &law.parameters()[k];
                p.map.raw(self.parameters[k]) / unit(p)
            }
            Unknown::Contact => self.contact,
            Unknown::Friction => self.friction.max(LEAST_FRICTION).log10(),
            Unknown::Depth(axis) => self.depth[axis],
        };
        free.list(law).into_iter().map(coordinate).collect()
    }

    /// Whether the body spins.
    pub fn spins(&self) -> bool {
        self.spin != [0.0; 3]
    }

    /// The same unknowns with the free ones moved to these coordinates.
    #[must_use]
    pub fn moved(&self, law: &Law, free: Free, coordinates: &[f64]) -> Self {
        let mut moved = self.clone();
        for (unknown, coordinate) in free.list(law).into_iter().zip(coordinates) {
            match unknown {
                Unknown::Velocity(axis) => moved.velocity[axis] = coordinate * SPEED,
                Unknown::Spin(axis) => moved.spin[axis] = coordinate * TURNING,
                Unknown::Parameter(k) => {
                    let p = &law.parameters()[k];
                    moved.parameters[k] = p.map.value(coordinate * unit(p));
                }
                Unknown::Contact => moved.contact = *coordinate,
                Unknown::Friction => moved.friction = 10f64.powf(*coordinate),
                Unknown::Depth(axis) => moved.depth[axis] = *coordinate,
            }
        }
        moved
    }

    /// How fast a free unknown changes with its coordinate, in its own unit.
    pub fn slope(&self, law: &Law, unknown: Unknown) -> f64 {
        match unknown {
            Unknown::Velocity(_) => SPEED,
            Unknown::Spin(_) => TURNING,
            Unknown::Parameter(k) => {
                let p = &law.parameters()[k];
                p.map.derivative(p.map.raw(self.parameters[k])) * unit(p)
            }
            Unknown::Friction => std::f64::consts::LN_10 * self.friction.max(LEAST_FRICTION),
            Unknown::Contact | Unknown::Depth(_) => 1.0,
        }
    }

    /// Constants of a tape for them: nothing is differentiated.
    ///
    /// # Errors
    /// Never for `f32` and `f64`.
    pub fn constants(&self, tape: &Tape, dtype: DType) -> Result<Bound> {
        let constant = |values: &[f64]| -> Result<Var> {
            Ok(tape.constant(Tensor::from_vec(values.to_vec(), [values.len()]).cast(dtype)?))
        };
        let parameters = self.parameters.iter().map(|value| constant(&[*value])).collect::<Result<_>>()?;
        let spin = self.spins().then(|| constant(&self.spin)).transpose()?;
        let velocity = constant(&self.velocity)?;
        let (turning, friction) = ((self.spin, false), constant(&[self.friction])?);
        Ok(Bound {
            leaves: Vec::new(),
            turning,
            velocity,
            spin,
            parameters,
            friction,
            contact: self.contact,
            depth: self.depth,
        })
    }

    /// The same, with the free parameters of the material from their coordinates `[n]` on a tape; what else is free stays as it is.
    ///
    /// # Errors
    /// Never for coordinates in `f32` and `f64`, as many as are free.
    pub(in crate::identify) fn moved_on_tape(&self, law: &Law, free: Free, coordinates: &Var) -> Result<Bound> {
        let mut moved = self.constants(coordinates.tape(), coordinates.dtype())?;
        for (index, unknown) in free.list(law).into_iter().enumerate() {
            if let Unknown::Parameter(k) = unknown {
                let p = &law.parameters()[k];
                moved.parameters[k] = constrained(p.map, &(&coordinates.slice(0, index..index + 1) * unit(p)));
            }
        }
        Ok(moved)
    }

    /// Variables of a tape for them; the free ones are leaves.
    ///
    /// # Errors
    /// Never for `f32` and `f64`.
    pub fn bind(&self, tape: &Tape, law: &Law, free: Free, dtype: DType) -> Result<Bound> {
        let tensor = |values: Vec<f64>| {
            let count = values.len();
            Tensor::from_vec(values, [count]).cast(dtype)
        };
        let mut leaves = Vec::new();
        let mut make = |value: Tensor, is_free: bool| {
            if is_free {
                leaves.push(tape.leaf(value));
                leaves[leaves.len() - 1].clone()
            } else {
                tape.constant(value)
            }
        };
        let raw_velocity = make(tensor(self.velocity.map(|v| v / SPEED).to_vec())?, free.velocity());
        let velocity = &raw_velocity * SPEED;
        let mut spin = None;
        if self.spins() || free.spin() {
            spin = Some(&make(tensor(self.spin.map(|w| w / TURNING).to_vec())?, free.spin()) * TURNING);
        }
        let mut parameters = Vec::new();
        for (k, (parameter, value)) in law.parameters().iter().zip(&self.parameters).enumerate() {
            let unit = unit(parameter);
            let coordinate = make(tensor(vec![parameter.map.raw(*value) / unit])?, free.parameter(k, parameter.map));
            parameters.push(constrained(parameter.map, &(&coordinate * unit)));
        }
        let raw = self.friction.max(LEAST_FRICTION).log10();
        let friction = match free.friction() {
            true => constrained(Map::Log10, &make(tensor(vec![raw])?, true)),
            false => make(tensor(vec![self.friction])?, false),
        };
        let turning = (self.spin, free.spin());
        Ok(Bound { leaves, turning, velocity, spin, parameters, friction, contact: self.contact, depth: self.depth })
    }
}

impl Bound {
    /// The spin where nothing is to be differentiated in it.
    pub(in crate::identify) fn fixed_spin(&self) -> Result<[f64; 3]> {
        match self.turning {
            (spin, false) => Ok(spin),
            _ => Err(Error::new(ErrorKind::NoGradient, "the spin of a body in free flight has no gradient on a tape")
                .at("Problem::flying")
                .fix("use Problem::linearise, as Gauss–Newton does")),
        }
    }

    /// The gradient of a loss in the coordinates of the free unknowns.
    ///
    /// # Errors
    /// What the backward pass returns.
    pub fn gradient(&self, loss: &Var) -> Result<Vec<f64>> {
        let gradients = loss.backward()?;
        let mut all = Vec::new();
        for leaf in &self.leaves {
            all.extend(gradients.wrt(leaf)?.to_vec()?);
        }
        Ok(all)
    }
}

/// The physical value of an unconstrained variable, on the tape.
fn constrained(map: Map, raw: &Var) -> Var {
    match map {
        Map::Log10 => (raw * std::f64::consts::LN_10).exp(),
        Map::Linear => raw.clone(),
        Map::Bounded { low, high } => {
            let half = 0.5 * (high - low);
            &(&(raw / half).tanh() * half) + (low + half)
        }
    }
}
