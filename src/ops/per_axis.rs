//! Settings per spatial axis: one number for all of them, or one for each.

/// A setting of the spatial axes of an op: one number for all of them, or one for each, outermost first.
///
/// ```
/// use gradreel::ops::PerAxis;
///
/// assert_eq!(PerAxis::from(2).resolve(3), Some(vec![2, 2, 2]));
/// assert_eq!(PerAxis::from([1, 2]).resolve(2), Some(vec![1, 2]));
/// assert_eq!(PerAxis::from([1, 2]).resolve(3), None);
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct PerAxis(Setting);

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum Setting {
    All(usize),
    Each(Vec<usize>),
}

impl PerAxis {
    /// The numbers of `rank` axes, or `None` when there are numbers for another count of axes.
    ///
    /// ```
    /// use gradreel::ops::PerAxis;
    /// assert_eq!(PerAxis::from(2).resolve(3), Some(vec![2, 2, 2]));
    /// assert_eq!(PerAxis::from([1, 2]).resolve(3), None);
    /// ```
    pub fn resolve(&self, rank: usize) -> Option<Vec<usize>> {
        match &self.0 {
            Setting::All(value) => Some(vec![*value; rank]),
            Setting::Each(values) => (values.len() == rank).then(|| values.clone()),
        }
    }

    /// The numbers of three axes, the last `rank` of which are there; those before them get `absent`.
    pub(crate) fn three(&self, rank: usize, absent: usize) -> Option<[usize; 3]> {
        three(&self.resolve(rank)?, absent)
    }
}

/// At most three numbers as those of the last of three axes; the axes before them get `absent`.
pub(crate) fn three(values: &[usize], absent: usize) -> Option<[usize; 3]> {
    let mut all = [absent; 3];
    all.get_mut(3usize.checked_sub(values.len())?..)?.copy_from_slice(values);
    Some(all)
}

impl From<usize> for PerAxis {
    fn from(value: usize) -> Self {
        Self(Setting::All(value))
    }
}

impl<const N: usize> From<[usize; N]> for PerAxis {
    fn from(values: [usize; N]) -> Self {
        Self(Setting::Each(values.to_vec()))
    }
}

impl From<&[usize]> for PerAxis {
    fn from(values: &[usize]) -> Self {
        Self(Setting::Each(values.to_vec()))
    }
}
