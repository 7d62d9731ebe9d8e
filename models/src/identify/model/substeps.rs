//! The number of substeps a frame that evaluations of one search share.

/// The number of substeps a frame, and what is to be said of it.
///
/// A search shares one: the number is raised where a rollout needs more and never lowered, because a loss that an optimiser with
/// exact derivatives follows must not jump with the step.
///
/// ```
/// use gradreel_models::identify::Substeps;
///
/// let substeps = Substeps::least(32);
/// assert!(substeps.count == 32 && substeps.notes.is_empty());
/// ```
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Substeps {
    /// Substeps a frame; 0 for as many as are stable.
    pub count: usize,
    /// Retries with more of them, in words.
    pub notes: Vec<String>,
}

impl Substeps {
    /// At least so many substeps a frame.
    pub fn least(count: usize) -> Self {
        Self { count, notes: Vec::new() }
    }
}
