//! Where the time of a tape's ops goes.

use std::collections::HashMap;
use std::fmt;
use std::time::Duration;

use smallvec::SmallVec;

use crate::tape::Tape;
use crate::{Shape, Tensor};

/// The time that ops took, by name and shapes of operands. See [`Tape::with_profile`].
///
/// Printed, it is a table: ops in the order of their time, then the problems that took longest.
///
/// ```
/// use gradreel::{Tape, Tensor};
/// let tape = Tape::with_profile();
/// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0], [2]));
/// let _y = x.exp();
/// println!("{}", tape.profile());
/// ```
#[derive(Debug, Clone, Default)]
pub struct Profile {
    rows: HashMap<Key, (u64, Duration)>,
    total: Duration,
}

/// An op, and the shapes of its operands.
type Key = (String, SmallVec<[Shape; 3]>);

/// The time of one op on operands of some shapes.
///
/// ```
/// use gradreel::{Tape, Tensor};
/// let tape = Tape::with_profile();
/// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0], [2]));
/// let _y = x.exp();
/// for row in tape.profile().rows() {
///     println!("{row:?}");
/// }
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProfileRow {
    /// The op.
    pub op: String,
    /// The shapes of its operands.
    pub shapes: Vec<Shape>,
    /// How many times it ran.
    pub calls: u64,
    /// The time of all these runs.
    pub time: Duration,
}

impl Profile {
    /// Ops with the shapes of their operands, those that took longest first.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    /// let tape = Tape::with_profile();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0], [2]));
    /// let _y = x.exp();
    /// assert_eq!(tape.profile().rows().len(), 1);
    /// ```
    pub fn rows(&self) -> Vec<ProfileRow> {
        let row = |((op, shapes), (calls, time)): (&Key, &(u64, Duration))| ProfileRow {
            op: op.clone(),
            shapes: shapes.to_vec(),
            calls: *calls,
            time: *time,
        };
        let mut rows: Vec<ProfileRow> = self.rows.iter().map(row).collect();
        rows.sort_by_key(|row| std::cmp::Reverse(row.time));
        rows
    }

    /// The time of each op, whatever the shapes, the longest first: name, number of runs, time.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    /// let tape = Tape::with_profile();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0], [2]));
    /// let _y = x.exp();
    /// assert_eq!(tape.profile().by_op()[0].0, "exp");
    /// ```
    pub fn by_op(&self) -> Vec<(String, u64, Duration)> {
        let mut sums = HashMap::<&str, (u64, Duration)>::new();
        for ((op, _), (calls, time)) in &self.rows {
            let sum = sums.entry(op).or_default();
            *sum = (sum.0 + calls, sum.1 + *time);
        }
        let mut sums: Vec<_> = sums.into_iter().map(|(op, (calls, time))| (op.to_owned(), calls, time)).collect();
        sums.sort_by_key(|(_, _, time)| std::cmp::Reverse(*time));
        sums
    }

    /// The time of all ops.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    /// let tape = Tape::with_profile();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0], [2]));
    /// let _y = x.exp();
    /// let profile = tape.profile();
    /// assert_eq!(profile.total(), profile.by_op()[0].2);
    /// ```
    pub fn total(&self) -> Duration {
        self.total
    }

    pub(super) fn add<'t>(&mut self, op: String, inputs: impl Iterator<Item = &'t Tensor>, time: Duration) {
        let mut shapes = SmallVec::new();
        inputs.for_each(|x| shapes.push(x.shape().clone()));
        let (calls, sum) = self.rows.entry((op, shapes)).or_default();
        *calls += 1;
        *sum += time;
        self.total += time;
    }
}

impl Tape {
    /// An empty tape that measures how long its ops take, those that derivatives are written in included. What a derivative
    /// does beside ops is listed as `d` and the name of its op.
    ///
    /// On a GPU that is the time to hand the work over, not that of the work.
    ///
    /// ```
    /// use gradreel::{DType, Tape, Tensor};
    ///
    /// let tape = Tape::with_profile();
    /// let x = tape.leaf(Tensor::zeros([4, 8], DType::F32));
    /// x.matmul_transposed(&x).square().sum_all().backward()?;
    /// let profile = tape.profile();
    /// assert!(profile.by_op().iter().any(|(op, calls, _)| op == "matmul" && *calls == 3));
    /// println!("{profile}");
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn with_profile() -> Self {
        let tape = Self::new();
        tape.0.borrow_mut().profile = Some(Profile::default());
        tape
    }

    /// What was measured so far; nothing on a tape that was not made by [`Tape::with_profile`].
    ///
    /// ```
    /// # use gradreel::Tape;
    /// assert!(Tape::new().profile().rows().is_empty());
    /// ```
    pub fn profile(&self) -> Profile {
        self.0.borrow().profile.clone().unwrap_or_default()
    }
}

/// Problems that the table lists.
const LISTED: usize = 24;

impl fmt::Display for Profile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let total = self.total().as_secs_f64().max(1e-12);
        let mut line = |time: Duration, calls: u64, what: &dyn fmt::Display| {
            let seconds = time.as_secs_f64();
            writeln!(f, "{:10.3} ms {:5.1} % {calls:6} × {what}", seconds * 1e3, seconds / total * 100.0)
        };
        line(self.total(), self.rows.values().map(|(calls, _)| calls).sum(), &"all ops")?;
        for (op, calls, time) in self.by_op() {
            line(time, calls, &op)?;
        }
        for row in self.rows().into_iter().take(LISTED) {
            let shapes = row.shapes.iter().map(Shape::to_string).collect::<Vec<_>>().join(" ");
            line(row.time, row.calls, &format_args!("{} {shapes}", row.op))?;
        }
        Ok(())
    }
}
