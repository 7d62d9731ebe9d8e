//! Names that are made at run time.

use std::collections::HashSet;
use std::sync::{LazyLock, Mutex, PoisonError};

/// The text as a name of [`Parameter`](super::Parameter) or [`History`](super::History), for laws that make their names at
/// run time. Equal texts share one allocation, which is kept for good.
///
/// ```
/// use gradreel_models::physics::{Parameter, name};
///
/// let mode = 3;
/// let stiffness = Parameter::log10(name(&format!("stiffness_{mode}")), "k", "Pa", [1e3, 1e6]);
/// assert_eq!(stiffness.name, "stiffness_3");
/// ```
pub fn name(text: &str) -> &'static str {
    static KNOWN: LazyLock<Mutex<HashSet<&'static str>>> = LazyLock::new(Mutex::default);
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    match known.get(text) {
        Some(known) => known,
        None => {
            let new: &'static str = Box::leak(text.into());
            known.insert(new);
            new
        }
    }
}
