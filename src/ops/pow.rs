//! `pow`: `x^c` with a constant exponent `c`.

use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;

use crate::Var;
use crate::ops::{Case, Entry, Map, uniform};
use crate::scalar::Program;

pub(super) const ENTRY: Entry = Entry {
    name: "pow",
    gpu: true,
    cases: || {
        let case = |exponent: f64, range| Case::of(map(exponent), [uniform(1, [4, 5], range)]);
        vec![
            case(2.0, -2.0..2.0),
            case(3.0, -2.0..2.0),
            case(-1.0, 0.5..2.0),
            case(-2.0, -2.0..-0.5),
            case(0.5, 0.3..2.0),
            case(2.4, 0.3..2.0),
        ]
    },
};

/// The map of an exponent; the same one at every call of a thread, so that derivatives are built once.
fn map(exponent: f64) -> Rc<Map> {
    thread_local! {
        static TRACED: RefCell<HashMap<u64, Rc<Map>>> = RefCell::new(HashMap::new());
    }
    let trace = || Rc::new(Map::new(Program::trace("pow", &["x"], &["y"], |x| vec![x[0].powf(exponent)])));
    TRACED.with_borrow_mut(|known| known.entry(exponent.to_bits()).or_insert_with(trace).clone())
}

impl Var {
    /// `xᶜ` of each element with a constant exponent: by multiplications for small whole `c`, as a square root for ½. NaN
    /// for negative `x`, unless `c` is whole.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![-2.0f64, 0.0], [2]));
    /// let y = x.pow(3.0);
    /// assert_eq!(y.value()?.slice::<f64>(), &[-8.0, 0.0]);
    /// assert_eq!(y.sum_all().backward()?.wrt(&x)?.slice::<f64>(), &[12.0, 0.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn pow(&self, exponent: f64) -> Self {
        Self::run(map(exponent), &[self])
    }
}
