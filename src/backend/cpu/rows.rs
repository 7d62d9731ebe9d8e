//! Rows put together of parts: concatenation and padding.

use super::{CHUNK, filled};

/// What each row of a result takes from one source.
pub(crate) struct Part<'a, T> {
    /// Where the source's rows are, one after the other; zeros without one.
    pub(crate) values: Option<&'a [T]>,
    /// Elements of one of its rows.
    pub(crate) len: usize,
}

/// `rows` rows, each the parts' rows one after the other.
pub(crate) fn joined<T: bytemuck::Pod + Send + Sync>(rows: usize, parts: &[Part<'_, T>]) -> Vec<T> {
    let row: usize = parts.iter().map(|part| part.len).sum();
    filled(rows * row, CHUNK, |start, out: &mut [T]| {
        let mut done = 0;
        while done < out.len() {
            let number = (start + done) / row;
            // the place within the row, then within each part
            let mut place = (start + done) % row;
            for part in parts {
                if place >= part.len {
                    place -= part.len;
                    continue;
                }
                let run = (part.len - place).min(out.len() - done);
                let to = &mut out[done..done + run];
                match part.values {
                    Some(values) => to.copy_from_slice(&values[number * part.len + place..][..run]),
                    None => to.fill(T::zeroed()),
                }
                done += run;
                place = 0;
                if done == out.len() {
                    return;
                }
            }
        }
    })
}
