//! Coverage of the intervals, and success rate of the family choice.

use std::fmt::Write as _;

use super::{Cell, CellResult, ClipResults, Truth};
use crate::identify::VELOCITY;

/// One line for each cell with intervals on clips of known truth.
pub(super) fn summary(results: &[ClipResults]) -> String {
    let mut text = String::new();
    for cell in Cell::ALL {
        let known = results.iter().filter_map(|clip| Some((clip.truth.as_ref()?, clip.cells.get(cell.name())?)));
        let (mut fits, mut whole, mut numbers, mut held, mut families) = (0, 0, 0, 0, 0);
        for (truth, result) in known {
            let holds = held_by(truth, result);
            fits += 1;
            families += usize::from(result.family == truth.family);
            numbers += holds.len();
            held += holds.iter().filter(|(_, holds)| *holds).count();
            whole += usize::from(!holds.is_empty() && holds.iter().all(|(_, holds)| *holds));
        }
        if numbers == 0 {
            continue;
        }
        write!(
            text,
            "\n{}: the 90 % intervals of {held} of {numbers} numbers hold the truth, those of all numbers of a clip in {whole} \
             of {fits} clips{}.\n",
            cell.label(),
            if cell == Cell::Auto { format!("; the family of {families} was found") } else { String::new() }
        )
        .expect("a string accepts every write");
    }
    text
}

/// For every known quantity with an interval: its name, and whether the interval contains the truth.
pub(super) fn held_by(truth: &Truth, result: &CellResult) -> Vec<(String, bool)> {
    let of = |name: &String| {
        let axis = VELOCITY.iter().position(|velocity| velocity == name);
        axis.map_or(truth.parameters.get(name).copied(), |axis| truth.velocity.map(|v| v[axis]))
    };
    let known = result.intervals.iter().filter_map(|(name, ends)| Some((name, ends, of(name)?)));
    known.map(|(name, [low, high], value)| (name.clone(), (*low..=*high).contains(&value))).collect()
}
