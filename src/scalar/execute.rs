//! The loop that runs register code: one pass over a block of lanes per step.

use super::instruction::{Binary, Unary};
use super::kernel::Job;
use super::lanes::{Lane, Port};
use super::lower::{Code, Op, SvdSlots, Term, UNUSED};
use super::real::Real;
use super::svd::svd;

/// Runs register code over `lanes` lanes, rounded up to whole vectors; the contract is that of
/// [`Kernel::execute`](super::kernel::Kernel::execute).
pub(super) struct Execute<'a, T> {
    pub(super) code: &'a Code,
    pub(super) ports: &'a mut [Port<T>],
    pub(super) lanes: usize,
}

impl<T: Real> Job<T> for Execute<'_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        // SAFETY: the caller's promise.
        unsafe { execute::<V>(self.code, self.ports, self.lanes) }
    }
}

/// One singular value decomposition over `vectors` vectors. A result may lie where an operand was: a vector's operands
/// are read before its results are written.
///
/// # Safety
/// As [`execute`].
#[inline(always)]
unsafe fn decompose<V: Lane>(slots: &SvdSlots, ports: &mut [Port<V::Element>], vectors: usize) {
    // SAFETY: the caller promises that the ports are valid for so many vectors.
    unsafe {
        // A result may lie where an operand repeats: that is read once, before anything is written.
        let mut first = [V::splat(V::Element::ZERO); 9];
        let mut inputs = [(std::ptr::null_mut(), false); 9];
        for n in 0..9 {
            let port = ports[slots.inputs[n] as usize];
            inputs[n] = (port.at, port.repeats);
            first[n] = V::load(port.at);
        }
        for i in 0..vectors {
            let mut entries = first;
            for n in 0..9 {
                let (at, repeats) = inputs[n];
                if !repeats {
                    entries[n] = V::load(at.add(i * V::WIDTH));
                }
            }
            let found = svd(entries);
            for n in 0..21 {
                if slots.outputs[n] != UNUSED {
                    let port = &mut ports[slots.outputs[n] as usize];
                    port.repeats = false;
                    found[n].store(port.at.add(i * V::WIDTH));
                }
            }
        }
    }
}

/// Runs register code over `lanes` lanes, rounded up to whole vectors.
///
/// What depends on repeated operands only, such as Lamé's parameters of shared moduli, is computed once and repeats, too;
/// its port says so until the slot is written again.
///
/// # Safety
/// As [`Kernel::execute`](super::kernel::Kernel::execute), with the instruction set of `V` enabled.
#[inline(always)]
unsafe fn execute<V: Lane>(code: &Code, ports: &mut [Port<V::Element>], lanes: usize) {
    let all = lanes.div_ceil(V::WIDTH);
    let first_temporary = code.first_temporary();
    let mut spare = [[V::Element::ZERO; 16]; 5];
    for step in &code.steps {
        macro_rules! port {
            ($slot:ident) => {{
                let port = ports[step.$slot as usize];
                (port.at, if port.repeats { 0 } else { V::WIDTH })
            }};
        }
        // Computes a value of the operands named, vector by vector. An operand that repeats and lies where results go is moved
        // aside first.
        macro_rules! each {
            ($($x:ident),* => $value:expr) => {{
                $(let mut $x = port!($x);)*
                let repeats = step.dst as usize >= first_temporary $(&& $x.1 == 0)*;
                let port = &mut ports[step.dst as usize];
                port.repeats = repeats;
                let (dst, vectors) = (port.at, if repeats { 1 } else { all });
                let mut aside = spare.iter_mut();
                $(if let Some(aside) = aside.next()
                    && $x.1 == 0
                    && $x.0 == dst
                {
                    // SAFETY: a port that repeats is valid for a vector, and no vector is wider than 16.
                    unsafe { V::load($x.0).store(aside.as_mut_ptr()) };
                    $x.0 = aside.as_mut_ptr();
                })*
                for i in 0..vectors {
                    // SAFETY: the caller promises that the ports are valid for `lanes` rounded up to vectors.
                    unsafe {
                        $(let $x = V::load($x.0.add(i * $x.1));)*
                        $value.store(dst.add(i * V::WIDTH));
                    }
                }
            }};
        }
        // The second of a chain, of the first one's value.
        macro_rules! chain {
            ($last:ident, $($slot:ident),* => $c:ident $d:ident $first:expr) => {
                match $last {
                    Term::MulAdd => each!($($slot),* => $c.mul_add($d, $first)),
                    Term::MulSub => each!($($slot),* => $c.mul_sub($d, $first)),
                    Term::NegMulAdd => each!($($slot),* => $c.neg_mul_add($d, $first)),
                    Term::Mul => unreachable!("a chain ends with a sum"),
                }
            };
        }
        match step.op {
            Op::Svd(n) => {
                // SAFETY: the caller's promise covers the slots of every step.
                unsafe { decompose::<V>(&code.svds[n as usize], ports, all) }
            }
            Op::Copy => each!(a => a),
            Op::Select => each!(a, b, c => a.choose(b, c)),
            Op::MulAdd => each!(a, b, c => a.mul_add(b, c)),
            Op::MulSub => each!(a, b, c => a.mul_sub(b, c)),
            Op::NegMulAdd => each!(a, b, c => a.neg_mul_add(b, c)),
            Op::Chain(first, last) => match first {
                Term::Mul => chain!(last, a, b, c, d => c d a.mul(b)),
                Term::MulAdd => chain!(last, a, b, c, d, e => c d a.mul_add(b, e)),
                Term::MulSub => chain!(last, a, b, c, d, e => c d a.mul_sub(b, e)),
                Term::NegMulAdd => chain!(last, a, b, c, d, e => c d a.neg_mul_add(b, e)),
            },
            Op::Binary(op) => match op {
                Binary::Add => each!(a, b => a.add(b)),
                Binary::Sub => each!(a, b => a.sub(b)),
                Binary::Mul => each!(a, b => a.mul(b)),
                Binary::Div => each!(a, b => a.div(b)),
                Binary::Min => each!(a, b => a.min(b)),
                Binary::Max => each!(a, b => a.max(b)),
                Binary::Powf => each!(a, b => a.powf(b)),
                Binary::Lt => each!(a, b => a.lt(b)),
                Binary::Le => each!(a, b => a.le(b)),
            },
            Op::Unary(op) => match op {
                Unary::Neg => each!(a => a.neg()),
                Unary::Abs => each!(a => a.abs()),
                Unary::Sign => each!(a => a.sign()),
                Unary::Floor => each!(a => a.floor()),
                Unary::Recip => each!(a => a.recip()),
                Unary::Sqrt => each!(a => a.sqrt()),
                Unary::Exp => each!(a => a.exp()),
                Unary::Ln => each!(a => a.ln()),
                Unary::Sin => each!(a => a.sin()),
                Unary::Cos => each!(a => a.cos()),
                Unary::Tanh => each!(a => a.tanh()),
                Unary::Logistic => each!(a => a.logistic()),
                Unary::Softplus => each!(a => a.softplus()),
                Unary::Ln1p => each!(a => a.ln_1p()),
                Unary::ExpM1 => each!(a => a.exp_m1()),
                Unary::Erf => each!(a => a.erf()),
            },
        }
    }
}
