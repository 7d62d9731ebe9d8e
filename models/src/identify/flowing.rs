//! What is done otherwise for bodies that flow: compact where they begin, they end in sheets and rims thinner than a grid cell.

use gradreel::Result;
use serde::{Deserialize, Serialize};

use crate::identify::config::{check_surface, outside_range};
use crate::identify::{Config, EstimateConfig, Observed, Steps};
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
    /// How occupancy becomes opacity, on a grid of the particles' spacing. That of the simulation, of twice that, loses thin rims: of a pile of
    /// sand, the angle of friction that fitted best was 3 degrees too small.
    pub surface: Surface,
    /// [`FitSettings::smoothness`](crate::field::FitSettings::smoothness). Sharp pictures drive pits into what is smooth, and a
    /// body that would flow has no thin parts to lose.
    pub smoothness: f64,
    /// How far the derivatives of Gauss–Newton reach, in shares of its longest step; 0 for those of an infinitesimal step. Rims jump by
    /// pixels, and pictures then change only in bands narrower than the jump. They reach to both sides where a search begins and after a step that gained
    /// little, from where they reach a quarter as far, twice at most; else to where the last step went, for half the rollouts. Half as
    /// far as on the simulation's grid would do: what a cell is across is what hides a valley.
    pub secant: f64,
    /// In place of [`FitSettings::in_motion`](crate::field::FitSettings::in_motion): a body that flows takes twice as long to simulate, and of a torus
    /// of 8000 voxels the material came out the same after 18 iterations as after 25.
    pub in_motion: usize,
    /// In place of `estimate.fine`: the valleys of four unknowns are long, and what a shape is fitted to before the end of one is reached
    /// keeps the search there.
    pub fine: usize,
    /// In place of `estimate.falling`.
    pub falling: usize,
    /// The first so many steps of `fine` are tried on the full grid and on a finer one: all that follows is on that which the clip agrees
    /// better with. 0 for no finer grid.
    pub finer: usize,
}

impl Default for FlowingConfig {
    fn default() -> Self {
        Self {
            laws: ["newtonian", "viscoplastic", "drucker_prager"].map(str::to_owned).to_vec(),
            surface: Surface { spacing: 1.0, step: 1.0, depth: 6.0, low: 0.45, ..Surface::default() },
            smoothness: 0.03,
            secant: 0.1,
            in_motion: 18,
            fine: 14,
            falling: 6,
            finer: 5,
        }
    }
}

impl FlowingConfig {
    /// Whether the values make sense.
    pub(super) fn check(&self) -> Result<()> {
        check_surface(&self.surface, "flowing.surface")?;
        let least = [("flowing.smoothness", self.smoothness, 1e3), ("flowing.secant", self.secant, 1.0)];
        match least.iter().find(|(_, value, most)| !(0.0..=*most).contains(value)) {
            Some((name, _, most)) => Err(outside_range(name, &format!("0 to {most}"))),
            None => Ok(()),
        }
    }
}

impl Config {
    /// Whether a body of this law flows, or is treated alike because the family is still to be chosen: pictures that differ cannot be
    /// compared.
    pub fn flows(&self, law: &Law) -> bool {
        self.chooses_family() || self.spreads(law)
    }

    /// Whether a body of this law flows, chosen or not.
    fn spreads(&self, law: &Law) -> bool {
        self.flowing.laws.iter().any(|name| name == law.name())
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

    /// How far the derivatives of Gauss–Newton reach for this law, in shares of its longest step, also while the family is still to be chosen: how a
    /// search goes does not change what pictures are compared.
    pub fn secant_of(&self, law: &Law) -> f64 {
        if self.spreads(law) { self.flowing.secant } else { 0.0 }
    }

    /// Gauss–Newton steps of the search for the material of this law; half of those that are taken in any case in each round.
    pub fn fine_of(&self, law: &Law) -> Steps {
        let (EstimateConfig { fine, falling, .. }, flowing) = (&self.estimate, &self.flowing);
        let [always, falling] = if self.flows(law) { [flowing.fine, flowing.falling] } else { [*fine, *falling] };
        Steps { falling, ..Steps::from(always) }
    }

    /// The frames that the first searches for the material of this law see of what was filmed, which touch the ground from `contact` on.
    /// A single camera tells the velocity by all of them, and by the early ones little; but how what leans tips over and rolls on misleads it more.
    pub fn early_of(&self, law: &Law, contact: usize, observed: &Observed, leans: bool) -> usize {
        let frames = observed.targets.len();
        let early = contact as f64 + self.estimate.early * frames.saturating_sub(contact) as f64;
        let all = observed.views.len() == 1 && !leans || self.flows(law) || !law.is_elastic();
        if all { frames } else { (early.ceil() as usize).clamp(1, frames) }
    }
}
