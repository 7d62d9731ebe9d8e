//! The materials that come with the crate, one file each.

mod neo_hookean;

pub use neo_hookean::NeoHookean;

use super::law::Law;

/// Every shipped material. Being listed here gets a material tested.
pub fn all() -> Vec<Law> {
    vec![Law::of(NeoHookean)]
}

/// The shipped material of this name.
pub fn find(name: &str) -> Option<Law> {
    all().into_iter().find(|law| law.name() == name)
}
