//! The instruction set, and what each instruction means, written once for `f32` and `f64`.

use super::real::Real;

/// Instructions of one operand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Unary {
    Neg,
    Abs,
    /// −1, 0 or 1; keeps the sign of a zero and passes NaN on.
    Sign,
    Floor,
    Recip,
    Sqrt,
    Exp,
    Ln,
    Sin,
    Cos,
    Tanh,
    /// `1 / (1 + e⁻ˣ)`
    Logistic,
    /// `ln(1 + eˣ)`
    Softplus,
    /// `ln(1 + x)`
    Ln1p,
    /// `eˣ − 1`
    ExpM1,
    /// The error function.
    Erf,
}

/// Instructions of two operands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Binary {
    Add,
    Sub,
    Mul,
    Div,
    /// The smaller; the first on a tie; NaN if either is NaN.
    Min,
    /// The larger; the first on a tie; NaN if either is NaN.
    Max,
    /// `aᵇ`; NaN for `a < 0`, unless `b` is whole.
    Powf,
    /// 1 where `a < b`, else 0; false for NaN.
    Lt,
    /// 1 where `a ≤ b`, else 0; false for NaN.
    Le,
}

impl Unary {
    /// Every instruction of one operand.
    #[cfg(test)]
    pub const ALL: [Self; 16] = [
        Self::Neg,
        Self::Abs,
        Self::Sign,
        Self::Floor,
        Self::Recip,
        Self::Sqrt,
        Self::Exp,
        Self::Ln,
        Self::Sin,
        Self::Cos,
        Self::Tanh,
        Self::Logistic,
        Self::Softplus,
        Self::Ln1p,
        Self::ExpM1,
        Self::Erf,
    ];

    /// The name in listings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Neg => "neg",
            Self::Abs => "abs",
            Self::Sign => "sign",
            Self::Floor => "floor",
            Self::Recip => "recip",
            Self::Sqrt => "sqrt",
            Self::Exp => "exp",
            Self::Ln => "ln",
            Self::Sin => "sin",
            Self::Cos => "cos",
            Self::Tanh => "tanh",
            Self::Logistic => "logistic",
            Self::Softplus => "softplus",
            Self::Ln1p => "ln_1p",
            Self::ExpM1 => "exp_m1",
            Self::Erf => "erf",
        }
    }

    /// The value for one number.
    #[inline]
    pub fn eval<T: Real>(self, x: T) -> T {
        match self {
            Self::Neg => -x,
            Self::Abs => x.abs(),
            Self::Sign => x.sign(),
            Self::Floor => x.floor(),
            Self::Recip => T::ONE / x,
            Self::Sqrt => x.sqrt(),
            Self::Exp => x.exp(),
            Self::Ln => x.ln(),
            Self::Sin => x.sin(),
            Self::Cos => x.cos(),
            Self::Tanh => x.tanh(),
            Self::Logistic => x.logistic(),
            Self::Softplus => x.softplus(),
            Self::Ln1p => x.ln_1p(),
            Self::ExpM1 => x.exp_m1(),
            Self::Erf => x.erf(),
        }
    }
}

impl Binary {
    /// Every instruction of two operands.
    #[cfg(test)]
    pub const ALL: [Self; 9] =
        [Self::Add, Self::Sub, Self::Mul, Self::Div, Self::Min, Self::Max, Self::Powf, Self::Lt, Self::Le];

    /// The name in listings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Add => "add",
            Self::Sub => "sub",
            Self::Mul => "mul",
            Self::Div => "div",
            Self::Min => "min",
            Self::Max => "max",
            Self::Powf => "powf",
            Self::Lt => "lt",
            Self::Le => "le",
        }
    }

    /// The value for one pair of numbers.
    #[inline]
    pub fn eval<T: Real>(self, a: T, b: T) -> T {
        let truth = |holds: bool| if holds { T::ONE } else { T::ZERO };
        match self {
            Self::Add => a + b,
            Self::Sub => a - b,
            Self::Mul => a * b,
            Self::Div => a / b,
            Self::Min => a.min(b),
            Self::Max => a.max(b),
            Self::Powf => a.powf(b),
            Self::Lt => truth(a < b),
            Self::Le => truth(a <= b),
        }
    }
}
