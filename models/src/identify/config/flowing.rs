//! What is done otherwise for fluid-like bodies: compact where they begin, they end in sheets and rims thinner than a grid cell.

use gradreel::Result;
use serde::{Deserialize, Serialize};

use crate::identify::Config;
use crate::identify::config::{check_surface, outside_range};
use crate::physics::Law;
use crate::render::Surface;

/// How bodies are pictured, fitted and searched that flow.
///
/// ```
/// use gradreel_models::identify::Config;
/// use gradreel_models::physics::materials;
///
/// let (sand, rubber) = (materials::find("drucker_prager").unwrap(), materials::find("neo_hookean").unwrap());
/// let config = Config::default();
/// assert!(config.surface_of(&sand).spacing < config.surface_of(&rubber).spacing);
/// // one's own material, too
/// let config = Config::parse("[flowing]\nlaws = [\"neo_hookean\"]")?;
/// assert_eq!(config.surface_of(&rubber).spacing, 1.0);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FlowingConfig {
    /// Names of the laws whose bodies flow.
    pub laws: Vec<String>,
    /// How occupancy becomes opacity, on a grid of the particles' spacing: that of the simulation, of twice that, loses thin rims.
    #[serde(skip)]
    pub(crate) surface: Surface,
    /// [`FitSettings::smoothness`](crate::field::FitSettings::smoothness). Sharp pictures drive pits into what is smooth, and a
    /// body that would flow has no thin parts to lose.
    pub smoothness: f64,
    /// In place of [`FitSettings::in_motion`](crate::field::FitSettings::in_motion): pictures drawn on the finer grid take longer.
    pub in_motion: usize,
}

impl Default for FlowingConfig {
    fn default() -> Self {
        Self {
            laws: ["newtonian", "viscoplastic", "drucker_prager"].map(str::to_owned).to_vec(),
            surface: Surface { spacing: 1.0, step: 1.0, depth: 6.0, low: 0.45, ..Surface::default() },
            smoothness: 0.03,
            in_motion: 18,
        }
    }
}

impl FlowingConfig {
    /// Whether the values make sense.
    pub(in crate::identify) fn check(&self) -> Result<()> {
        check_surface(&self.surface, "flowing.surface")?;
        match (0.0..=1e3).contains(&self.smoothness) {
            true => Ok(()),
            false => Err(outside_range("flowing.smoothness", "0 to 1000")),
        }
    }
}

impl Config {
    /// Whether a body of this law flows, or is treated alike because the family is still to be chosen: pictures that differ cannot be
    /// compared.
    pub fn flows(&self, law: &Law) -> bool {
        self.chooses_family() || self.flowing.laws.iter().any(|name| name == law.name())
    }

    /// How occupancy becomes opacity in a body of this law.
    pub fn surface_of(&self, law: &Law) -> &Surface {
        if self.flows(law) { &self.flowing.surface } else { &self.surface }
    }

    /// What the area of its surface counts while a body of this law is fitted.
    pub fn smoothness_of(&self, law: &Law) -> f64 {
        if self.flows(law) { self.flowing.smoothness } else { self.geometry.fit.smoothness }
    }

    /// Iterations of fitting the shape of a body of this law to its motion, in each round.
    pub fn in_motion_of(&self, law: &Law) -> usize {
        if self.flows(law) { self.flowing.in_motion } else { self.geometry.fit.in_motion }
    }
}
