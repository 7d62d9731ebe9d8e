//! Anomaly mode: names the first op that made a value or a gradient non-finite.

use std::panic::Location;

use crate::tape::Op;
use crate::{Error, ErrorKind, Result, Tensor};

/// Fails if the result of an op is not finite.
pub(super) fn check_value(op: &dyn Op, inputs: &[Tensor], output: &Tensor, place: &Location<'_>) -> Result<()> {
    if output.all_finite()? {
        return Ok(());
    }
    let ranges = inputs.iter().map(describe).collect::<Result<Vec<_>>>()?;
    Err(Error::new(ErrorKind::NonFinite, format!("{} made a non-finite value", op.name())).at(place).found(format!(
        "{}; operands: {}",
        describe(output)?,
        ranges.join(", ")
    )))
}

/// Fails if a cotangent is not finite.
pub(super) fn check_cotangent(
    op: &dyn Op,
    index: usize,
    gradient: &Tensor,
    cotangent: &Tensor,
    place: &Location<'_>,
) -> Result<()> {
    if cotangent.all_finite()? {
        return Ok(());
    }
    Err(Error::new(ErrorKind::NonFinite, format!("the derivative of {} made a non-finite gradient", op.name()))
        .at(place)
        .found(format!("operand {index}: {}; cotangent of the result: {}", describe(cotangent)?, describe(gradient)?)))
}

/// Shape, finite range and number of non-finite elements.
fn describe(x: &Tensor) -> Result<String> {
    let values = x.to_vec()?;
    let bad = values.iter().filter(|v| !v.is_finite()).count();
    let (low, high) = values
        .iter()
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)));
    let range = if low <= high { format!("in [{low:.3e}, {high:.3e}]") } else { "nothing finite".to_owned() };
    Ok(format!("{:?} {range}, {bad} of {} non-finite", x.spec(), values.len()))
}
