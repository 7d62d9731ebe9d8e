//! Running a program over lanes on the CPU.
//!
//! Lanes are taken in blocks of 256, so that the values of a block stay in the first-level cache while every step of
//! the code passes over them once. Inputs are read, and outputs written, in place; only the last, partial block goes
//! through padded copies. The scratch memory belongs to the thread and is reused: a call allocates nothing once warm.

use std::cell::RefCell;

use smallvec::SmallVec;

use super::instruction::{Binary, Unary};
use super::lanes::Port;
use super::lower::Op;
use super::path::Path;
use super::program::Program;
use super::real::Real;

/// Lanes per block.
const BLOCK: usize = 256;

/// The values of one input over the lanes of a run.
///
/// ```
/// use gradreel::scalar::{Lanes, Program};
/// let f = Program::trace("scaled", &["a", "x"], &["y"], |v| vec![v[0] * v[1]]);
/// let mut y = [0.0; 3];
/// f.run(3, &[Lanes::Same(2.0), Lanes::Each(&[1.0, 2.0, 3.0])], &mut [&mut y]);
/// assert_eq!(y, [2.0, 4.0, 6.0]);
/// ```
#[derive(Debug, Clone, Copy)]
pub enum Lanes<'a, T> {
    /// One value per lane.
    Each(&'a [T]),
    /// The same value in every lane.
    Same(T),
}

/// One cache line; the unit of scratch memory, and as wide as the widest vector.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Line([u8; 64]);

#[derive(Default)]
struct Scratch {
    lines: Vec<Line>,
    /// Storage for the ports of a run, as untyped (address, repeats).
    ports: Vec<Port<u8>>,
}

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::default();
}

impl Program {
    /// Runs the program on `len` lanes, one after another block on the calling thread.
    ///
    /// Products feeding a sum may be fused, so that results differ between processors in the last place.
    ///
    /// ```
    /// use gradreel::scalar::{Lanes, Program};
    ///
    /// let program = Program::trace("axpy", &["a", "x", "y"], &["z"], |v| vec![v[0] * v[1] + v[2]]);
    /// let mut z = [0.0_f32; 3];
    /// program.run(3, &[Lanes::Same(2.0), Lanes::Each(&[1.0, 2.0, 3.0]), Lanes::Same(0.5)], &mut [&mut z]);
    /// assert_eq!(z, [2.5, 4.5, 6.5]);
    /// ```
    ///
    /// # Panics
    /// If the number of inputs or outputs differs from the program's, or a slice has another length than `len`.
    #[track_caller]
    pub fn run<T: Real>(&self, len: usize, inputs: &[Lanes<'_, T>], outputs: &mut [&mut [T]]) {
        self.run_on(Path::best(), len, inputs, outputs);
    }

    /// The outputs for one lane; for tests and occasional values.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].square()]);
    /// assert_eq!(f.eval(&[3.0]), [9.0]);
    /// ```
    ///
    /// # Panics
    /// If the number of inputs differs.
    #[track_caller]
    pub fn eval<T: Real>(&self, inputs: &[T]) -> Vec<T> {
        let lanes: Vec<Lanes<'_, T>> = inputs.iter().map(|&x| Lanes::Same(x)).collect();
        let mut values = vec![T::ZERO; self.outputs().len()];
        let mut outputs: Vec<&mut [T]> = values.chunks_mut(1).collect();
        self.run(1, &lanes, &mut outputs);
        values
    }

    /// The only output for one lane of a program that adds, subtracts, multiplies and divides: what [`Program::run`] gives,
    /// bit by bit, as these are rounded alike everywhere. `None` for any other program.
    pub(crate) fn arithmetic<T: Real>(&self, inputs: &[T]) -> Option<T> {
        let code = self.code();
        let (outputs, constants) = (inputs.len() + code.constants.len(), &code.constants);
        let mut values = SmallVec::<[T; 16]>::from_slice(inputs);
        values.extend(constants.iter().map(|&c| T::from_f64(c)));
        values.resize(code.slots(), T::ZERO);
        for step in &code.steps {
            let (a, b) = (values[step.a as usize], values[step.b as usize]);
            values[step.dst as usize] = match step.op {
                Op::Copy => a,
                Op::Unary(Unary::Neg) => -a,
                Op::Binary(Binary::Add) => a + b,
                Op::Binary(Binary::Sub) => a - b,
                Op::Binary(Binary::Mul) => a * b,
                Op::Binary(Binary::Div) => a / b,
                _ => return None,
            };
        }
        Some(values[outputs])
    }

    /// [`Program::run`] with a given instruction set, which must be available.
    #[track_caller]
    pub(super) fn run_on<T: Real>(&self, path: Path, len: usize, inputs: &[Lanes<'_, T>], outputs: &mut [&mut [T]]) {
        self.check_lanes(len, inputs, outputs);
        SCRATCH.with_borrow_mut(|scratch| run_blocks(self, path, len, inputs, outputs, scratch));
    }

    #[track_caller]
    fn check_lanes<T>(&self, len: usize, inputs: &[Lanes<'_, T>], outputs: &[&mut [T]]) {
        let name = self.name();
        for (what, found, wanted) in
            [("inputs", inputs.len(), self.inputs().len()), ("outputs", outputs.len(), self.outputs().len())]
        {
            assert!(found == wanted, "scalar program {name}: {found} {what}, {wanted} wanted");
        }
        for (input, of) in inputs.iter().zip(self.inputs()) {
            if let Lanes::Each(values) = input {
                let found = values.len();
                assert!(found == len, "scalar program {name}: input {of} has {found} lanes, {len} wanted");
            }
        }
        for (output, of) in outputs.iter().zip(self.outputs()) {
            let found = output.len();
            assert!(found == len, "scalar program {name}: output {of} has {found} lanes, {len} wanted");
        }
    }
}

fn run_blocks<T: Real>(
    program: &Program,
    path: Path,
    len: usize,
    inputs: &[Lanes<'_, T>],
    outputs: &mut [&mut [T]],
    scratch: &mut Scratch,
) {
    let code = program.code();
    let in_line = size_of::<Line>() / size_of::<T>();
    let lines_per_block = BLOCK / in_line;
    // Scratch: a line per input and constant, then a block per input and output for the last lanes, then temporaries.
    let repeated = inputs.len() + code.constants.len();
    let blocks = inputs.len() + outputs.len() + code.temporaries;
    let lines = repeated + blocks * lines_per_block;
    if scratch.lines.len() < lines {
        scratch.lines.resize(lines, Line([0; 64]));
    }
    let base = scratch.lines.as_mut_ptr().cast::<T>();
    let line = |n: usize| base.wrapping_add(n * in_line);
    let block = |n: usize| line(repeated + n * lines_per_block);

    let ports = ports_of::<T>(&mut scratch.ports, code.slots());
    let same = inputs.iter().map(|input| if let Lanes::Same(x) = input { Some(*x) } else { None });
    for (n, value) in same.chain(code.constants.iter().map(|&c| Some(T::from_f64(c)))).enumerate() {
        if let Some(value) = value {
            // SAFETY: line `n` lies within the scratch memory.
            unsafe { std::slice::from_raw_parts_mut(line(n), in_line).fill(value) };
            ports[n] = Port { at: line(n), repeats: true };
        }
    }
    for n in 0..code.temporaries {
        ports[repeated + outputs.len() + n] = Port { at: block(inputs.len() + outputs.len() + n), repeats: false };
    }
    for start in (0..len).step_by(BLOCK) {
        let lanes = BLOCK.min(len - start);
        let partial = lanes < BLOCK;
        for (n, input) in inputs.iter().enumerate() {
            let Lanes::Each(values) = input else { continue };
            let values = &values[start..start + lanes];
            ports[n] = Port { at: values.as_ptr().cast_mut(), repeats: false };
            if partial {
                ports[n].at = block(n);
                // SAFETY: block `n` lies within the scratch memory and nothing else refers to it now.
                let padded = unsafe { std::slice::from_raw_parts_mut(block(n), BLOCK) };
                padded[..lanes].copy_from_slice(values);
                padded[lanes..lanes.next_multiple_of(16)].fill(values[lanes - 1]);
            }
        }
        for (n, output) in outputs.iter_mut().enumerate() {
            let at = if partial { block(inputs.len() + n) } else { output[start..].as_mut_ptr() };
            ports[repeated + n] = Port { at, repeats: false };
        }
        // SAFETY: the path is available by this function's contract with `run_on`. Ports point at whole blocks of
        // scratch memory, at one line where they repeat, or at 256 lanes of an input, which no step writes, or of an
        // output.
        unsafe { T::execute(path, code, ports, lanes) };
        if partial {
            for (n, output) in outputs.iter_mut().enumerate() {
                // SAFETY: as above; the steps have run.
                output[start..].copy_from_slice(unsafe { std::slice::from_raw_parts(block(inputs.len() + n), lanes) });
            }
        }
    }
}

/// Room for `count` ports in storage that is shared by both element types.
fn ports_of<T>(storage: &mut Vec<Port<u8>>, count: usize) -> &mut [Port<T>] {
    storage.clear();
    storage.resize(count, Port { at: std::ptr::null_mut(), repeats: false });
    // SAFETY: `Port<T>` is a pointer to a sized type and a bool whatever `T` is; `repr(C)` fixes their order.
    unsafe { std::slice::from_raw_parts_mut(storage.as_mut_ptr().cast::<Port<T>>(), count) }
}
