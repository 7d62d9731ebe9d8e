//! Hypotheses about what was filmed: their pool, and how they are chosen among.

mod hypothesis;

pub(crate) use hypothesis::{Hypothesis, apart};
