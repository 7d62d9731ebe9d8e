//! Pointwise ops: a scalar program applied to every element.
//!
//! Operands broadcast to a common shape. On the CPU a stretched operand is spread out chunk by chunk while it is used, and
//! on a GPU beforehand. The derivative with respect to an operand is again a map (of the program's vjp), so pointwise ops
//! can be differentiated any number of times.

use std::cell::{OnceCell, RefCell};
use std::rc::Rc;

use smallvec::SmallVec;

use crate::backend::cpu::strided::read;
use crate::backend::cpu::{CHUNK, filled};
use crate::backend::gpu::{Gpu, Kernel, Strides, words};
use crate::ops::broadcast_to::steps;
use crate::ops::{Case, Entry};
use crate::scalar::{Lanes, Program, Real, Scalar};
use crate::tape::{AddressMap, Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Error, ErrorKind, Result, Shape, Spec, Tensor};

/// The names of the kernel's buffers: the result and as many operands as WebGPU guarantees beside it.
const BUFFERS: &[&str] = &["y", "x0", "x1", "x2", "x3", "x4", "x5", "x6"];

/// A pointwise op of `N` operands, written once as an ordinary function.
///
/// ```
/// use gradreel::ops::Pointwise;
/// use gradreel::{Tape, Tensor};
///
/// static CUBE: Pointwise<1> = Pointwise {
///     name: "cube",
///     function: |[x]| x * x * x,
///     cases: || vec![[Tensor::from_vec(vec![-2.0, 0.0, 3.0], [3])]],
///     entry: Vec::new,
/// };
/// let tape = Tape::new();
/// let x = tape.leaf(Tensor::from_vec(vec![2.0], [1]));
/// assert_eq!(CUBE.apply([&x]).backward()?.wrt(&x)?.item()?, 12.0);
/// # Ok::<(), gradreel::Error>(())
/// ```
pub struct Pointwise<const N: usize> {
    /// Its name in errors and tables.
    pub name: &'static str,
    /// The function of one element per operand.
    pub function: fn([Scalar; N]) -> Scalar,
    /// Operands for the shared tests, including the places where it could break.
    pub cases: fn() -> Vec<[Tensor; N]>,
    /// The entry of the registry, which needs a function without captures: `|| cases(&OP)`.
    pub entry: fn() -> Vec<Case>,
}

impl<const N: usize> Pointwise<N> {
    /// The op with its program traced; the same one at every call of a thread, so that derivatives are built once.
    ///
    /// ```
    /// use gradreel::ops::Pointwise;
    /// use gradreel::{Tape, Tensor};
    ///
    /// static CUBE: Pointwise<1> = Pointwise {
    ///     name: "cube",
    ///     function: |[x]| x * x * x,
    ///     cases: || vec![[Tensor::from_vec(vec![-2.0, 0.0, 3.0], [3])]],
    ///     entry: Vec::new,
    /// };
    /// # let _ = Tape::new;
    /// assert_eq!(CUBE.op().program().eval(&[2.0]), [8.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn op(&self) -> Rc<Map> {
        thread_local! {
            static TRACED: RefCell<AddressMap<(usize, usize), Rc<Map>>> = RefCell::default();
        }
        let key = (self.name.as_ptr() as usize, self.function as usize);
        if let Some(map) = TRACED.with_borrow(|known| known.get(&key).cloned()) {
            return map;
        }
        let names: Vec<String> = (0..N).map(|i| format!("x{i}")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let program =
            Program::trace(self.name, &names, &["y"], |x| vec![(self.function)(std::array::from_fn(|i| x[i]))]);
        let map = Rc::new(Map::new(program));
        TRACED.with_borrow_mut(|known| known.insert(key, map.clone()));
        map
    }

    /// Applies it to variables, broadcasting them to a common shape.
    ///
    /// ```
    /// use gradreel::ops::Pointwise;
    /// use gradreel::{Tape, Tensor};
    ///
    /// static CUBE: Pointwise<1> = Pointwise {
    ///     name: "cube",
    ///     function: |[x]| x * x * x,
    ///     cases: || vec![[Tensor::from_vec(vec![-2.0, 0.0, 3.0], [3])]],
    ///     entry: Vec::new,
    /// };
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![2.0], [1]));
    /// assert_eq!(CUBE.apply([&x]).item()?, 8.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes do not broadcast.
    #[track_caller]
    pub fn apply(&self, inputs: [&Var; N]) -> Var {
        Var::run(self.op(), &inputs)
    }

    /// Its place in the registry.
    pub(crate) const fn entry(&self) -> Entry {
        Entry { name: self.name, gpu: true, cases: self.entry }
    }

    /// Its cases as the registry wants them.
    pub(crate) fn all_cases(&self) -> Vec<Case> {
        (self.cases)().into_iter().map(|inputs| Case::of(self.op(), inputs)).collect()
    }

    /// Its cases, when it answers a question with 0 or 1: then NaN gives an answer, too.
    pub(crate) fn conditions(&self) -> Vec<Case> {
        self.all_cases().into_iter().map(Case::condition).collect()
    }
}

/// A scalar program with one output, as an op on tensors.
///
/// ```
/// use gradreel::{ops::Map, scalar::Program};
/// let map = Map::new(Program::trace("square", &["x"], &["y"], |x| vec![x[0].square()]));
/// assert_eq!(map.program().name(), "square");
/// ```
#[derive(Debug)]
pub struct Map {
    program: Program,
    partials: Vec<OnceCell<Partial>>,
    kernel: OnceCell<Kernel>,
}

/// How the cotangent of one operand follows from the operands and the cotangent of the result.
#[derive(Debug)]
enum Partial {
    /// It is 0 everywhere.
    Zero,
    /// It is the cotangent of the result.
    Same,
    /// A map of some of the operands; the number after the last operand's stands for the cotangent of the result.
    Map(Rc<Map>, Vec<usize>),
}

impl Partial {
    /// The operands that it reads.
    fn operands(&self) -> &[usize] {
        match self {
            Self::Zero | Self::Same => &[],
            Self::Map(_, operands) => operands,
        }
    }
}

impl Map {
    /// The op of a program.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor, ops::Map, scalar::Program};
    /// let program = Program::trace("product", &["x", "y"], &["xy"], |x| vec![x[0] * x[1]]);
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![2.0], [1]));
    /// let y = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// assert_eq!(x.apply(Map::new(program), &[&y])?.item()?, 6.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the program has not exactly one output.
    #[track_caller]
    pub fn new(program: Program) -> Self {
        assert_eq!(program.outputs().len(), 1, "map: the program {} must have one output", program.name());
        let partials = (0..program.inputs().len()).map(|_| OnceCell::new()).collect();
        Self { program, partials, kernel: OnceCell::new() }
    }

    /// The program applied to each element.
    ///
    /// ```
    /// use gradreel::{ops::Map, scalar::Program};
    /// let map = Map::new(Program::trace("square", &["x"], &["y"], |x| vec![x[0].square()]));
    /// assert_eq!(map.program().eval(&[3.0]), [9.0]);
    /// ```
    pub fn program(&self) -> &Program {
        &self.program
    }

    /// The derivative with respect to one operand, without the operands that it does not depend on.
    fn partial(&self, input: usize) -> &Partial {
        self.partials[input].get_or_init(|| {
            let whole = self.program.vjp_wrt(&[input]);
            let count = whole.inputs().len();
            let used: Vec<usize> = (0..count).filter(|&n| whole.depends(0, n)).collect();
            match used[..] {
                [] => Partial::Zero,
                [only] if only == count - 1 && whole.is_empty() => Partial::Same,
                _ => {
                    let names: Vec<&str> = used.iter().map(|&n| whole.inputs()[n].as_str()).collect();
                    let part = Program::trace(whole.name(), &names, &[whole.outputs()[0].as_str()], |given| {
                        let mut all = vec![Scalar::from(0.0); count];
                        used.iter().zip(given).for_each(|(&n, &x)| all[n] = x);
                        whole.apply(&all)
                    });
                    Partial::Map(Rc::new(Self::new(part)), used)
                }
            }
        })
    }

    /// The kernel around the program, made at the first call.
    ///
    /// ```
    /// use gradreel::{ops::Map, scalar::Program};
    /// let map = Map::new(Program::trace("square", &["x"], &["y"], |x| vec![x[0].square()]));
    /// map.kernel()?.reflect()?; // validated, without a GPU
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Unsupported`] when there are more operands than a kernel may bind.
    pub fn kernel(&self) -> Result<&Kernel> {
        let count = self.program.inputs().len();
        let Some(buffers) = BUFFERS.get(..=count) else {
            return Err(Error::new(ErrorKind::Unsupported, format!("{} has too many operands for a GPU", self.name()))
                .found(count)
                .wanted(format!("at most {}: a kernel binds {} buffers", BUFFERS.len() - 1, BUFFERS.len()))
                .fix(
                    "compose it of functions of fewer operands, or move them to the CPU with to_device(&Device::Cpu)",
                ));
        };
        Ok(self.kernel.get_or_init(|| {
            // under names of our own, so that none of the program's can hide one of the kernel's
            let operands = &buffers[1..];
            let program = Program::trace("program", operands, &["result"], |x| self.program.apply(x));
            let mut text = program.wgsl();
            for (n, x) in operands.iter().enumerate() {
                text += &format!("@group(0) @binding({}) var<storage, read> {x}: array<f32>;\n", n + 2);
            }
            let arguments: Vec<_> = operands.iter().enumerate().map(|(n, x)| format!("{x}[place(i, {n}u)]")).collect();
            text += &format!("fn value(i: u32) -> f32 {{ return program({}); }}\n", arguments.join(", "));
            Kernel::around(text, self.name().to_owned(), include_str!("../../kernels/map.wgsl"), buffers)
        }))
    }

    /// The common shape of operands.
    fn shape<'a>(&self, mut operands: impl Iterator<Item = &'a Shape>) -> Result<Shape> {
        let mut shape = operands.next().cloned().unwrap_or_default();
        // most operands are alike, and numbers on the tape must not pay for those that are not
        for x in operands {
            if *x != shape {
                shape = shape.broadcast(x).map_err(|e| e.at(self.name()))?;
            }
        }
        Ok(shape)
    }

    /// The result for operands of one element each.
    fn single<T: Real>(&self, inputs: &[Tensor]) -> T {
        let values: SmallVec<[T; 4]> = inputs.iter().map(|x| x.slice::<T>()[0]).collect();
        if let Some(result) = self.program.arithmetic(&values) {
            return result;
        }
        let lanes: SmallVec<[_; 4]> = values.iter().map(|&x| Lanes::Same(x)).collect();
        let mut result = [T::ZERO];
        self.program.run(1, &lanes, &mut [&mut result]);
        result[0]
    }

    fn run<T: Real>(&self, inputs: &[Tensor], shape: &Shape) -> Vec<T> {
        let operands: Vec<Operand<'_, T>> = inputs
            .iter()
            .map(|x| match x.slice::<T>() {
                [one] => Operand::Same(*one),
                many if many.len() == shape.len() => Operand::Each(many),
                many => Operand::Stretched(many, stretched(x.shape(), shape)),
            })
            .collect();
        let program = &self.program;
        let part = operands.iter().filter_map(Operand::part).min().unwrap_or(CHUNK);
        filled(shape.len(), CHUNK, |start, out: &mut [T]| {
            let mut spread: Vec<Vec<T>> = operands.iter().map(|x| x.room(part.min(out.len()))).collect();
            let mut done = 0;
            while done < out.len() {
                let start = start + done;
                let len = (part - start % part).min(out.len() - done);
                let lanes: Vec<Lanes<'_, T>> =
                    operands.iter().zip(&mut spread).map(|(x, room)| x.lanes(start, len, room)).collect();
                program.run(len, &lanes, &mut [&mut out[done..done + len]]);
                done += len;
            }
        })
    }
}

/// Equal neighbours from which on a stretched operand is not spread out.
const SAME: usize = 256;
/// Elements of a stretched operand spread out at a time.
const SPREAD: usize = 4096;

/// An operand of a map on the CPU.
enum Operand<'a, T> {
    /// One number for all elements.
    Same(T),
    /// A number for each.
    Each(&'a [T]),
    /// Something in between, with the axes along which it is read.
    Stretched(&'a [T], Strides),
}

impl<T: Real> Operand<'_, T> {
    /// Elements of the result that are computed at a time: as long as the operand stays the same, or as many as stay in
    /// the first-level cache once they are spread out.
    fn part(&self) -> Option<usize> {
        let Self::Stretched(_, axes) = self else { return None };
        let (run, step) = axes.axes().last()?;
        Some(if *step == 0 && *run >= SAME { *run } else { SPREAD })
    }

    /// Room for as many elements, where they do not lie ready.
    fn room(&self, len: usize) -> Vec<T> {
        if matches!(self, Self::Stretched(..)) { vec![T::ZERO; len] } else { Vec::new() }
    }

    /// The elements from `start` on.
    fn lanes<'b>(&'b self, start: usize, len: usize, room: &'b mut [T]) -> Lanes<'b, T> {
        match self {
            Self::Same(one) => Lanes::Same(*one),
            Self::Each(many) => Lanes::Each(&many[start..start + len]),
            Self::Stretched(values, axes) => match axes.axes().last() {
                Some((run, 0)) if start % run + len <= *run => Lanes::Same(values[axes.place(start)]),
                _ => {
                    read(values, 0, axes.axes(), start, &mut room[..len]);
                    Lanes::Each(&room[..len])
                }
            },
        }
    }
}

/// The axes along which an operand is read for a result of this shape.
fn stretched(x: &Shape, shape: &Shape) -> Strides {
    Strides::new(shape.dims().iter().copied().zip(steps(x, shape)))
}

impl Op for Map {
    fn name(&self) -> &str {
        self.program.name()
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let wrong =
            |what: &str| Error::new(ErrorKind::Shape, format!("{}: {what}", self.name())).found(format!("{inputs:?}"));
        if inputs.len() != self.program.inputs().len() {
            return Err(wrong("wrong number of operands").wanted(self.program.inputs().len()));
        }
        let dtype = inputs[0].dtype;
        if !dtype.is_real() || inputs.iter().any(|x| x.dtype != dtype) {
            return Err(wrong("operands must be all f32 or all f64"));
        }
        Ok(Spec { shape: self.shape(inputs.iter().map(|x| &x.shape))?, dtype })
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let shape = self.shape(inputs.iter().map(Tensor::shape))?;
        for_real!(inputs[0].dtype(), T => Ok(match shape.len() {
            1 => Tensor::one(self.single::<T>(&inputs), shape),
            _ => Tensor::from_vec(self.run::<T>(&inputs, &shape), shape),
        }
        .into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let specs: Vec<_> = inputs.iter().map(Tensor::spec).collect();
        let result = self.infer(&specs)?;
        let len = result.shape.len();
        let spread = |x: &Tensor| {
            if x.len() == 1 || x.len() == len {
                return Ok(x.clone());
            }
            stretched(x.shape(), &result.shape).gather(gpu, self.name(), x, 0, result.clone())
        };
        let operands: Vec<Tensor> = inputs.iter().map(spread).collect::<Result<_>>()?;
        let operands: Vec<&Tensor> = operands.iter().collect();
        let each = operands.iter().enumerate().fold(0, |each, (n, x)| each | usize::from(x.len() != 1) << n);
        Ok(gpu.launch_each(self.kernel()?, &operands, |_, count| words([count, each]).to_vec(), result)?.into())
    }

    fn reads(&self, wanted: &[bool]) -> Reads {
        let operands = self.program.inputs().len();
        let wanted = (0..operands).filter(|&i| wanted[i]);
        wanted
            .flat_map(|i| self.partial(i).operands())
            .filter(|&&n| n < operands)
            .fold(Reads::nothing(), |reads, &n| reads.input(n))
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let operand = |n: usize| if n < cx.inputs().len() { cx.input(n) } else { cx.gradient() };
        let cotangent = |i: usize| -> Result<Var> {
            let x = cx.input(i);
            let each = match self.partial(i) {
                Partial::Zero => {
                    let zeros = Tensor::zeros(x.shape(), x.dtype()).to_device(&x.device())?;
                    return Ok(x.tape().constant(zeros));
                }
                Partial::Same => cx.gradient().clone(),
                Partial::Map(map, operands) => {
                    let operands: SmallVec<[_; 4]> = operands.iter().map(|&n| operand(n)).collect();
                    Var::run(map.clone(), &operands)
                }
            };
            Ok(if each.shape() == x.shape() { each } else { each.sum_to(x.shape()) })
        };
        (0..cx.inputs().len()).map(|i| cx.wants(i).then(|| cotangent(i)).transpose()).collect()
    }
}

impl Var {
    /// Applies a function written once to every element: `x.map("cubed", |x| x * x * x)`.
    ///
    /// The function is traced at the call; keep a [`Map`] and use [`Var::apply`] in inner loops.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0f64, -2.0], [2]));
    /// let y = x.map("swish", |x| x * x.logistic());
    /// assert!((y.value()?.slice::<f64>()[0] - 0.731_058_578_630).abs() < 1e-9);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    /// # Panics
    /// When the function uses values of another trace.
    #[track_caller]
    #[must_use]
    pub fn map(&self, name: &str, function: impl FnOnce(Scalar) -> Scalar) -> Self {
        let program = Program::trace(name, &["x"], &["y"], |x| vec![function(x[0])]);
        Self::run(Rc::new(Map::new(program)), &[self])
    }

    /// As [`Var::map`], for a function of this and another operand; shapes broadcast.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![3.0f64, 0.0], [2]));
    /// let y = tape.leaf(Tensor::from_vec(vec![4.0f64], [1]));
    /// let r = x.map2("hypotenuse", &y, |x, y| (x * x + y * y).sqrt());
    /// assert_eq!(r.value()?.slice::<f64>(), &[5.0, 4.0]);
    /// assert_eq!(r.sum_all().backward()?.wrt(&y)?.slice::<f64>(), &[1.8]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes do not broadcast.
    #[track_caller]
    #[must_use]
    pub fn map2(&self, name: &str, other: &Self, function: impl FnOnce(Scalar, Scalar) -> Scalar) -> Self {
        Self::map_n(name, [self, other], |[x, y]| function(x, y))
    }

    /// As [`Var::map`], for a function of any number of operands; shapes broadcast. A GPU takes up to seven.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor, Var};
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// let y = tape.leaf(Tensor::from_vec(vec![4.0], [1]));
    /// let length = Var::map_n("length", [&x, &y], |[x, y]| (x * x + y * y).sqrt());
    /// assert_eq!(length.item()?, 5.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes do not broadcast, or there is no operand.
    #[track_caller]
    #[must_use]
    pub fn map_n<const N: usize>(
        name: &str,
        operands: [&Self; N],
        function: impl FnOnce([Scalar; N]) -> Scalar,
    ) -> Self {
        let names: Vec<String> = (0..N).map(|i| format!("x{i}")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let program = Program::trace(name, &names, &["y"], |x| vec![function(std::array::from_fn(|i| x[i]))]);
        Self::run(Rc::new(Map::new(program)), &operands)
    }
}
