//! The shipped materials, one file each.
//!
//! | name | example | parameters |
//! |---|---|---|
//! | [`NeoHookean`] | rubber | `E`, `ν` |
//! | [`FixedCorotated`] | rubber that may invert | `E`, `ν` |
//! | [`KelvinVoigt`] | rubber that bounces less | `E`, `ν`, relaxation time |
//! | [`StvkHencky`] | metal within its elastic range | `E`, `ν` |
//! | [`VonMises`] | plasticine | `E`, `ν`, yield stress |
//! | [`Viscoplastic`] | toothpaste | `μ`, `κ`, yield stress, plastic viscosity |
//! | [`DruckerPrager`] | sand, dry or damp | `E`, `ν`, friction angle, cohesion |
//! | [`Newtonian`] | water, honey | viscosity, `κ` |
//! | [`Snow`] | snow | `E`, `ν`, critical compression and stretch, hardening |
//! | [`Learned`] | any elastic material, or the residual of another law | weights of a network |

mod drucker_prager;
mod fixed_corotated;
mod hencky;
mod kelvin_voigt;
mod learned;
mod neo_hookean;
mod newtonian;
mod snow;
mod stvk_hencky;
mod viscoplastic;
mod von_mises;

pub use drucker_prager::DruckerPrager;
pub use fixed_corotated::FixedCorotated;
pub use kelvin_voigt::KelvinVoigt;
pub use learned::Learned;
pub use neo_hookean::NeoHookean;
pub use newtonian::Newtonian;
pub use snow::Snow;
pub use stvk_hencky::StvkHencky;
pub use viscoplastic::Viscoplastic;
pub use von_mises::{VonMises, YieldConvention};

use std::sync::{PoisonError, RwLock};

use gradreel::{Error, ErrorKind, Result};

use super::law::Law;

/// Laws that a program has added.
static OWN: RwLock<Vec<Law>> = RwLock::new(Vec::new());

/// Adds a law under its name, for `--material`, scenes, and going on with runs: what a program of one's own does first
/// ([`cli::run_with`](crate::cli::run_with)).
///
/// # Errors
///
/// [`ErrorKind::Input`] if a shipped law, a family or a law that was added has this name.
pub fn register(law: Law) -> Result<()> {
    let taken = find(law.name()).is_some()
        || FAMILIES.iter().map(|(family, _)| *family).chain([AUTO]).any(|name| name == law.name());
    if taken {
        return Err(Error::new(ErrorKind::Input, "a law of this name exists")
            .found(law.name())
            .fix("give it another name"));
    }
    OWN.write().unwrap_or_else(PoisonError::into_inner).push(law);
    Ok(())
}

/// The families of materials by the names that people use, and their laws.
pub const FAMILIES: [(&str, &str); 5] = [
    ("elastic", "neo_hookean"),
    ("plasticine", "von_mises"),
    ("newtonian", "newtonian"),
    ("non_newtonian", "viscoplastic"),
    ("sand", "drucker_prager"),
];

/// The name that lets every family try.
pub const AUTO: &str = "auto";

/// Every shipped material. The tests cover all materials listed here.
pub fn all() -> Vec<Law> {
    vec![
        Law::of(DruckerPrager),
        Law::of(FixedCorotated),
        Law::of(KelvinVoigt),
        Law::of(Learned::alone(6, 1e5, 1)),
        Law::of(Learned::residual(NeoHookean, 6, 1e4, 1)),
        Law::of(NeoHookean),
        Law::of(Newtonian),
        Law::of(Snow),
        Law::of(StvkHencky),
        Law::of(Viscoplastic::default()),
        Law::of(VonMises::default()),
    ]
}

/// The material of this name, shipped or added.
pub fn find(name: &str) -> Option<Law> {
    let own = || OWN.read().unwrap_or_else(PoisonError::into_inner).iter().find(|law| law.name() == name).cloned();
    all().into_iter().find(|law| law.name() == name).or_else(own)
}
