//! Symbolic values of WGSL: numbers of a program, integers that are known, truths, and aggregates of them.

use std::rc::Rc;

use gradreel::scalar::{Condition, Mat3, Scalar, Vec3};

/// Whether something holds: known, or different for each particle.
#[derive(Debug, Clone, Copy)]
pub(super) enum Truth {
    Known(bool),
    Varies(Condition),
}

impl From<Condition> for Truth {
    fn from(condition: Condition) -> Self {
        match condition.to_scalar().constant() {
            Some(value) => Self::Known(value != 0.0),
            None => Self::Varies(condition),
        }
    }
}

impl Truth {
    pub fn not(self) -> Self {
        match self {
            Self::Known(holds) => Self::Known(!holds),
            Self::Varies(condition) => condition.not().into(),
        }
    }

    pub fn and(self, other: Self) -> Self {
        match (self, other) {
            (Self::Known(false), _) | (_, Self::Known(false)) => Self::Known(false),
            (Self::Known(true), other) | (other, Self::Known(true)) => other,
            (Self::Varies(a), Self::Varies(b)) => a.and(b).into(),
        }
    }

    pub fn or(self, other: Self) -> Self {
        match (self, other) {
            (Self::Known(true), _) | (_, Self::Known(true)) => Self::Known(true),
            (Self::Known(false), other) | (other, Self::Known(false)) => other,
            (Self::Varies(a), Self::Varies(b)) => a.or(b).into(),
        }
    }

    /// `a` where this holds, else `b`.
    pub fn choose(self, a: Self, b: Self) -> Self {
        match (self, a, b) {
            (Self::Known(true), a, _) => a,
            (Self::Known(false), _, b) => b,
            (_, Self::Known(a), Self::Known(b)) if a == b => Self::Known(a),
            _ => self.and(a).or(self.not().and(b)),
        }
    }

    /// 1 where this holds, else 0.
    pub fn number(self) -> Scalar {
        match self {
            Self::Known(holds) => f64::from(u8::from(holds)).into(),
            Self::Varies(condition) => condition.to_scalar(),
        }
    }
}

/// A variable, or a part of one.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Place {
    pub slot: usize,
    pub path: Vec<u32>,
}

#[derive(Debug, Clone)]
pub(super) enum Value {
    Number(Scalar),
    Truth(Truth),
    Integer(i64),
    /// An integer that differs between particles, which nothing may read.
    Unknown,
    /// Components of a vector, columns of a matrix, elements of an array, members of a structure.
    Many(Rc<Vec<Self>>),
    Place(Rc<Place>),
}

impl From<Scalar> for Value {
    fn from(x: Scalar) -> Self {
        Self::Number(x)
    }
}

impl From<Truth> for Value {
    fn from(truth: Truth) -> Self {
        Self::Truth(truth)
    }
}

impl From<Vec3> for Value {
    fn from(v: Vec3) -> Self {
        Self::many(v.0.map(Self::Number))
    }
}

impl From<Mat3> for Value {
    fn from(m: Mat3) -> Self {
        Self::many([0, 1, 2].map(|j| m.column(j).into()))
    }
}

impl Value {
    pub fn many(values: impl IntoIterator<Item = Self>) -> Self {
        Self::Many(Rc::new(values.into_iter().collect()))
    }

    pub fn parts(&self) -> &[Self] {
        match self {
            Self::Many(parts) => parts,
            _ => &[],
        }
    }

    /// The numbers of a scalar or a vector.
    pub fn numbers(&self) -> Option<Vec<Scalar>> {
        match self {
            Self::Number(x) => Some(vec![*x]),
            Self::Many(parts) => parts.iter().map(Self::number).collect(),
            _ => None,
        }
    }

    pub fn number(&self) -> Option<Scalar> {
        match self {
            Self::Number(x) => Some(*x),
            _ => None,
        }
    }

    pub fn vec3(&self) -> Option<Vec3> {
        self.numbers()?.try_into().ok().map(Vec3)
    }

    /// A matrix of three columns of three rows.
    pub fn mat3(&self) -> Option<Mat3> {
        let columns: Vec<Vec3> = self.parts().iter().map(Self::vec3).collect::<Option<_>>()?;
        let columns: [Vec3; 3] = columns.try_into().ok()?;
        Some(Mat3(columns.map(|column| column.0)).t())
    }

    /// All numbers, a matrix row by row.
    pub fn flat(&self) -> Option<Vec<Scalar>> {
        match self.mat3() {
            Some(matrix) => Some(matrix.to_vec()),
            None => self.numbers(),
        }
    }

    /// Whether no number in it depends on a particle.
    pub fn is_known(&self) -> bool {
        match self {
            Self::Number(x) => x.constant().is_some(),
            Self::Truth(truth) => matches!(truth, Truth::Known(_)),
            Self::Many(parts) => parts.iter().all(Self::is_known),
            Self::Integer(_) | Self::Unknown | Self::Place(_) => true,
        }
    }

    /// How many scalars it has.
    pub fn len(&self) -> usize {
        match self {
            Self::Many(parts) => parts.iter().map(Self::len).sum(),
            _ => 1,
        }
    }

    /// `f` of each number, truth or integer.
    pub fn map<E>(&self, f: &mut impl FnMut(&Self) -> Result<Self, E>) -> Result<Self, E> {
        match self {
            Self::Many(parts) => {
                Ok(Self::Many(Rc::new(parts.iter().map(|part| part.map(f)).collect::<Result<_, E>>()?)))
            }
            _ => f(self),
        }
    }

    /// `f` of each pair; a single value goes with all of the other.
    pub fn zip<E>(&self, other: &Self, f: &mut impl FnMut(&Self, &Self) -> Result<Self, E>) -> Result<Self, E> {
        match (self, other) {
            (Self::Many(a), Self::Many(b)) => {
                Ok(Self::Many(Rc::new(a.iter().zip(b.iter()).map(|(a, b)| a.zip(b, f)).collect::<Result<_, E>>()?)))
            }
            (Self::Many(_), b) => self.map(&mut |a| f(a, b)),
            (a, Self::Many(_)) => other.map(&mut |b| f(a, b)),
            (a, b) => f(a, b),
        }
    }

    /// `a` where the condition holds, else `b`; both of one type.
    pub fn choose(condition: Truth, a: &Self, b: &Self) -> Self {
        let condition = match condition {
            Truth::Known(holds) => return if holds { a.clone() } else { b.clone() },
            Truth::Varies(condition) => condition,
        };
        match (a, b) {
            (Self::Many(p), Self::Many(q)) if Rc::ptr_eq(p, q) => a.clone(),
            (Self::Many(p), Self::Many(q)) => {
                Self::many(p.iter().zip(q.iter()).map(|(p, q)| Self::choose(Truth::Varies(condition), p, q)))
            }
            (Self::Number(p), Self::Number(q)) => match (p.constant(), q.constant()) {
                (Some(p), Some(q)) if p.to_bits() == q.to_bits() => a.clone(),
                _ => Self::Number(condition.select(*p, *q)),
            },
            (Self::Truth(p), Self::Truth(q)) => Self::Truth(Truth::Varies(condition).choose(*p, *q)),
            (Self::Integer(p), Self::Integer(q)) if p == q => a.clone(),
            (Self::Place(p), Self::Place(q)) if p == q => a.clone(),
            _ => Self::Unknown,
        }
    }

    /// The part at a path.
    pub fn at(&self, path: &[u32]) -> Option<&Self> {
        path.iter().try_fold(self, |value, &index| value.parts().get(index as usize))
    }

    /// Replaces the part at a path.
    pub fn put(&mut self, path: &[u32], value: Self) -> Option<()> {
        match path.split_first() {
            None => *self = value,
            Some((&index, rest)) => match self {
                Self::Many(parts) => Rc::make_mut(parts).get_mut(index as usize)?.put(rest, value)?,
                _ => return None,
            },
        }
        Some(())
    }
}
