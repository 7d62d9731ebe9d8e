//! States of optimisers in files, under names that no parameter has.

use std::collections::BTreeMap;

use crate::io::TensorFile;
use crate::{Error, ErrorKind, Result, Tensor};

/// First components of paths that are not parameters.
pub(super) const RESERVED: [&str; 2] = ["optimizer", "ema"];

/// Whether a name in a file is a state rather than a parameter.
pub(super) fn is_state(name: &str) -> bool {
    name.split('.').next().is_some_and(|first| RESERVED.contains(&first))
}

/// Tensors that an optimiser keeps for each path.
pub(super) type States<const N: usize> = BTreeMap<String, [Tensor; N]>;

/// Adds states and their step counter to a file.
pub(super) fn save_states<const N: usize>(
    file: &mut TensorFile,
    optimiser: &str,
    kinds: [&str; N],
    steps: u64,
    states: &States<N>,
) {
    file.metadata.insert(format!("optimizer.{optimiser}.step"), steps.to_string());
    for (path, tensors) in states {
        for (kind, tensor) in kinds.iter().zip(tensors) {
            file.tensors.insert(format!("optimizer.{optimiser}.{kind}.{path}"), tensor.clone());
        }
    }
}

/// Reads what [`save_states`] wrote.
pub(super) fn restore_states<const N: usize>(
    file: &TensorFile,
    optimiser: &str,
    kinds: [&str; N],
) -> Result<(u64, States<N>)> {
    let steps = counter(file, &format!("optimizer.{optimiser}.step"))?;
    let first = format!("optimizer.{optimiser}.{}.", kinds[0]);
    let states = file.tensors.range(first.clone()..).take_while(|(name, _)| name.starts_with(&first));
    let states = states.map(|(name, _)| {
        let path = &name[first.len()..];
        let mut tensors = Vec::with_capacity(N);
        for kind in kinds {
            tensors.push(file.get(&format!("optimizer.{optimiser}.{kind}.{path}"))?.clone());
        }
        Ok((path.to_owned(), tensors.try_into().expect("one tensor of each kind")))
    });
    let states: States<N> = states.collect::<Result<_>>()?;
    let all = format!("optimizer.{optimiser}.");
    let saved = file.tensors.range(all.clone()..).take_while(|(name, _)| name.starts_with(&all)).count();
    if saved != N * states.len() {
        return Err(Error::new(ErrorKind::Input, "the optimiser's state is incomplete")
            .found(format!("{saved} tensors for {} paths", states.len()))
            .wanted(format!("{kinds:?} for each path")));
    }
    Ok((steps, states))
}

/// A whole number in the metadata.
pub(super) fn counter(file: &TensorFile, key: &str) -> Result<u64> {
    let found = file.metadata.get(key);
    found.and_then(|text| text.parse().ok()).ok_or_else(|| {
        Error::new(ErrorKind::Input, "the file holds no state to go on from")
            .at(key)
            .found(format!("{found:?}"))
            .wanted("a number of steps in the metadata")
    })
}
