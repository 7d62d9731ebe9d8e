//! The shipped materials, one file each.
//!
//! | name | example | parameters |
//! |---|---|---|
//! | [`NeoHookean`] | rubber | `E`, `ν` |
//! | [`FixedCorotated`] | rubber that may invert | `E`, `ν` |
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
mod learned;
mod neo_hookean;
mod newtonian;
mod snow;
mod stvk_hencky;
mod viscoplastic;
mod von_mises;

pub use drucker_prager::DruckerPrager;
pub use fixed_corotated::FixedCorotated;
pub use learned::Learned;
pub use neo_hookean::NeoHookean;
pub use newtonian::Newtonian;
pub use snow::Snow;
pub use stvk_hencky::StvkHencky;
pub use viscoplastic::Viscoplastic;
pub use von_mises::{VonMises, YieldConvention};

use super::law::Law;

/// Every shipped material. The tests cover all materials listed here.
pub fn all() -> Vec<Law> {
    vec![
        Law::of(DruckerPrager),
        Law::of(FixedCorotated),
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

/// The shipped material of this name.
pub fn find(name: &str) -> Option<Law> {
    all().into_iter().find(|law| law.name() == name)
}
