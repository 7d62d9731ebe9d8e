//! The surroundings of the particles: grid spacing, gravity, obstacles, limits.

use super::collider::Collider;
use gradreel::{Error, ErrorKind, Result};

/// The surroundings of a simulation. The world's y axis points up; lengths are in metres.
///
/// ```
/// use gradreel_models::physics::{Collider, World};
///
/// let world = World { colliders: vec![Collider::ground(0.0)], ..World::new(0.02) };
/// assert_eq!(world.gravity, [0.0, -9.8, 0.0]);
/// assert!((world.particle_volume - 1e-6).abs() < 1e-18); // eight particles per cell
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct World {
    /// Grid spacing \[m\].
    pub dx: f64,
    /// Gravity \[m/s²\].
    pub gravity: [f64; 3],
    /// Obstacles, applied in this order.
    pub colliders: Vec<Collider>,
    /// The share of its own velocity that a particle keeps: 0 for APIC, 1 for FLIP. A particle's new velocity is
    /// `Σ w v_i + flip (v − Σ w v_i⁰)`, where `v_i⁰` is the grid velocity before forces; it moves with `Σ w v_i`, and
    /// its affine velocity is that of APIC.
    pub flip: f64,
    /// Rest volume of a particle \[m³\].
    pub particle_volume: f64,
    /// Lowest and highest allowed position \[m\]; a particle outside ends the rollout with an error.
    pub bounds: Option<[[f64; 3]; 2]>,
    /// The largest number of grid nodes in the box around the particles.
    pub node_limit: usize,
}

impl World {
    /// Earth's gravity, no obstacles, no bounds, APIC, `(dx/2)³` per particle, at most 2²⁴ nodes.
    pub fn new(dx: f64) -> Self {
        Self {
            dx,
            gravity: [0.0, -9.8, 0.0],
            colliders: Vec::new(),
            flip: 0.0,
            particle_volume: (dx / 2.0).powi(3),
            bounds: None,
            node_limit: 1 << 24,
        }
    }

    /// Mass below which nodes are ignored: `1e-8 dx³` \[kg\].
    pub(crate) fn least_mass(&self) -> f64 {
        1e-8 * self.dx.powi(3)
    }

    /// Validates spacing, volume, gravity, transfer and obstacles.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Input`] naming the invalid value.
    pub(crate) fn check(&self) -> Result<()> {
        let positive = |x: f64| x.is_finite() && x > 0.0;
        let fault = |what: &str, found: String, wanted: &str| {
            Err(Error::new(ErrorKind::Input, what).at("World").found(found).wanted(wanted))
        };
        if !positive(self.dx) || !positive(self.particle_volume) {
            let found = format!("dx {} m, particle volume {} m³", self.dx, self.particle_volume);
            return fault("the grid spacing and the particle volume must be positive", found, "positive numbers");
        }
        if self.gravity.iter().any(|g| !g.is_finite()) {
            return fault("gravity is not finite", format!("{:?} m/s²", self.gravity), "three finite numbers");
        }
        if !(0.0..=1.0).contains(&self.flip) {
            return fault("the share of FLIP cannot be used", self.flip.to_string(), "0 (APIC) to 1 (FLIP)");
        }
        self.colliders.iter().enumerate().try_for_each(|(index, collider)| {
            collider.check().map_err(|e| e.within(format!("World::colliders[{index}]")))
        })
    }
}
