//! Checkpointing: segments of a network that are recomputed in the backward pass.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

use gradreel::{Error, ErrorKind, Result, Shape, Var};

use super::{Init, Scope, Weights};

/// A segment of a network. Built at a scope with recomputation ([`Scope::recomputed`]), its intermediate values are not
/// kept; the backward pass evaluates the segment again. Results are identical.
///
/// ```
/// use gradreel::{DType, Key, Tape, Tensor};
/// use gradreel_models::layers::{Linear, Scope, Segment, initialise};
///
/// let params = initialise(Key::new(1), DType::F64, |scope| Linear::new(scope, 3, 2))?;
/// let gradient = |recomputed: bool| {
///     let tape = Tape::new();
///     let bound = params.bind(&tape);
///     let scope = Scope::root(&bound);
///     let scope = if recomputed { scope.recomputed() } else { scope };
///     let part = Segment::new(&scope, |scope| Linear::new(scope, 3, 2))?;
///     let x = tape.constant(Tensor::full(0.5, [4, 3], DType::F64));
///     let y = part.run(&[&x], |linear, inputs| linear.forward(&inputs[0]).silu())?;
///     bound.gradients(&y.sum_all().backward()?)
/// };
/// assert_eq!(gradient(false)?["weight"].slice::<f64>(), gradient(true)?["weight"].slice::<f64>());
/// # Ok::<(), gradreel::Error>(())
/// ```
pub struct Segment<M> {
    module: M,
    again: Option<Again<M>>,
}

/// Builds a segment at a scope.
type Build<M> = dyn Fn(&Scope<'_>) -> Result<M>;

/// What recomputation needs: the builder, and the weights in the order of request.
struct Again<M> {
    build: Rc<Build<M>>,
    weights: Rc<[String]>,
    values: Vec<Var>,
}

impl<M: 'static> Segment<M> {
    /// The segment at a scope. `build` is called again with the same scope for every recomputation.
    ///
    /// # Errors
    /// Propagates errors of `build`.
    pub fn new(scope: &Scope<'_>, build: impl Fn(&Scope<'_>) -> Result<M> + 'static) -> Result<Self> {
        if !scope.is_recomputed() {
            return Ok(Self { module: build(scope)?, again: None });
        }
        let watched = Watched { inner: scope.weights(), asked: RefCell::default() };
        // relative names, independent of the location of the segment
        let module = build(&Scope::root(&Below { path: scope.path(), inner: &watched }))?;
        let (weights, values): (Vec<String>, Vec<Var>) = watched.asked.into_inner().into_iter().unzip();
        let weights = weights.iter().map(|path| below(scope.path(), path).to_owned()).collect();
        Ok(Self { module, again: Some(Again { build: Rc::new(build), weights, values }) })
    }

    /// Applies the segment: `forward` receives it with the operands.
    ///
    /// # Errors
    /// Propagates errors of rebuilding it.
    #[track_caller]
    pub fn run(&self, operands: &[&Var], forward: impl Fn(&M, &[Var]) -> Var + 'static) -> Result<Var> {
        let Some(again) = &self.again else {
            let operands: Vec<Var> = operands.iter().map(|x| (*x).clone()).collect();
            return Ok(forward(&self.module, &operands));
        };
        let (count, build, weights) = (operands.len(), again.build.clone(), again.weights.clone());
        let all: Vec<&Var> = operands.iter().copied().chain(&again.values).collect();
        operands[0].tape().remat(&all, move |_, all| {
            let (operands, values) = all.split_at(count);
            let given = Given { vars: weights.iter().map(String::as_str).zip(values).collect() };
            Ok(forward(&build(&Scope::root(&given))?, operands))
        })
    }
}

/// The part of a path below a scope.
fn below<'p>(place: &str, path: &'p str) -> &'p str {
    path.strip_prefix(place).map_or(path, |rest| rest.trim_start_matches('.'))
}

/// Forwards requests and records the answers, by full path.
struct Watched<'a> {
    inner: &'a dyn Weights,
    asked: RefCell<Vec<(String, Var)>>,
}

impl Weights for Watched<'_> {
    fn weight(&self, path: &str, shape: &Shape, init: Init) -> Result<Var> {
        let var = self.inner.weight(path, shape, init)?;
        self.asked.borrow_mut().push((path.to_owned(), var.clone()));
        Ok(var)
    }
}

/// A scope of a source as a source of its own.
struct Below<'a> {
    path: &'a str,
    inner: &'a dyn Weights,
}

impl Weights for Below<'_> {
    fn weight(&self, path: &str, shape: &Shape, init: Init) -> Result<Var> {
        let whole = if self.path.is_empty() { path.to_owned() } else { format!("{}.{path}", self.path) };
        self.inner.weight(&whole, shape, init)
    }
}

/// The weights of one recomputation.
struct Given<'a> {
    vars: BTreeMap<&'a str, &'a Var>,
}

impl Weights for Given<'_> {
    fn weight(&self, path: &str, _: &Shape, _: Init) -> Result<Var> {
        let asked_for_later = || Error::new(ErrorKind::Input, "a part asks for other weights than before").at(path);
        self.vars.get(path).map(|var| (*var).clone()).ok_or_else(asked_for_later)
    }
}
