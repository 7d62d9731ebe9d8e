//! Segments of a list: which rows belong together, as offsets.
//!
//! Segment `s` of a list of `n` rows is the rows `offsets[s] .. offsets[s + 1]`: `offsets` begins with 0, never falls, and
//! ends with `n`. So are the samples of all rays kept in one list.

use crate::{DType, Error, ErrorKind, Result, Spec};

/// The offsets of the segments in a list that names the segment of each row, in rising order.
///
/// ```
/// assert_eq!(gradreel::ops::segment_offsets(&[0, 0, 2, 2, 2], 4)?, [0, 2, 2, 5, 5]);
/// # Ok::<(), gradreel::Error>(())
/// ```
///
/// # Errors
/// [`ErrorKind::Input`] when the list falls somewhere, or names a segment that is not below `segments`.
pub fn segment_offsets(names: &[u32], segments: usize) -> Result<Vec<u32>> {
    let mut offsets = vec![0; segments + 1];
    let mut before = 0;
    for (at, &name) in names.iter().enumerate() {
        if name < before || name as usize >= segments {
            return Err(Error::new(ErrorKind::Input, "segment_offsets: rows must be in the order of their segments")
                .at(format!("names[{at}]"))
                .found(name)
                .wanted(format!("{before} to {}", segments.saturating_sub(1))));
        }
        before = name;
        offsets[name as usize + 1] += 1;
    }
    (0..segments).for_each(|s| offsets[s + 1] += offsets[s]);
    Ok(offsets)
}

/// Whether this may be a list of offsets.
pub(super) fn are_offsets(offsets: &Spec) -> bool {
    offsets.shape.rank() == 1 && !offsets.shape.is_empty() && offsets.dtype == DType::U32
}

/// Fails if the offsets are not those of a list of `len` rows.
pub(super) fn check_offsets(op: &str, offsets: &[u32], len: usize) -> Result<()> {
    let wrong = |at: usize, wanted: String| {
        Err(Error::new(ErrorKind::Input, format!("{op}: the offsets are not those of the list"))
            .at(format!("offsets[{at}]"))
            .found(offsets[at])
            .wanted(wanted))
    };
    let last = offsets.len() - 1;
    if offsets[0] != 0 {
        return wrong(0, "0".to_owned());
    }
    if let Some(at) = (0..last).find(|&at| offsets[at + 1] < offsets[at]) {
        return wrong(at + 1, format!("at least {}", offsets[at]));
    }
    if offsets[last] as usize != len {
        return wrong(last, format!("{len}, the length of the list"));
    }
    Ok(())
}
