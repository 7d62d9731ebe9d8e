//! Structural check of an ONNX file before the runtime parses it.
//!
//! The runtime allocates as many bytes as a field declares and recurses with the nesting of messages and the length
//! of operator chains. This check bounds both for damaged files.

/// Maximum nesting of messages: one graph takes six levels, and operators that hold graphs rarely nest.
const DEPTH: usize = 48;

/// Maximum number of operators.
const OPERATORS: usize = 100_000;

/// The messages of an ONNX file that the runtime parses.
#[derive(Clone, Copy)]
enum Message {
    Model,
    Graph,
    Operator,
    Attribute,
    Tensor,
    Value,
    Type,
    TensorType,
    SequenceType,
    Shape,
    /// One with only strings and numbers.
    Plain,
}

impl Message {
    /// The message type of a field number; `None` for strings, numbers and ignored fields.
    fn inside(self, field: u64) -> Option<Self> {
        match (self, field) {
            (Self::Model, 7) | (Self::Attribute, 6) => Some(Self::Graph),
            (Self::Graph, 1) => Some(Self::Operator),
            (Self::Graph, 5) | (Self::Attribute, 5) => Some(Self::Tensor),
            (Self::Graph, 11..=13) => Some(Self::Value),
            (Self::Operator, 5) => Some(Self::Attribute),
            (Self::Value, 2) | (Self::SequenceType, 1) => Some(Self::Type),
            (Self::Type, 1) => Some(Self::TensorType),
            (Self::Type, 4) => Some(Self::SequenceType),
            (Self::TensorType, 2) => Some(Self::Shape),
            (Self::Model, 8 | 14) | (Self::Tensor, 13) | (Self::Shape, 1) => Some(Self::Plain),
            _ => None,
        }
    }
}

/// Traverses every message of an ONNX file.
///
/// # Errors
/// A description of the fault: a field that exceeds its message, an unknown wire type, too many operators, or
/// messages nested too deep.
pub(super) fn check(bytes: &[u8]) -> Result<(), &'static str> {
    walk(Message::Model, bytes, DEPTH, &mut 0)
}

fn walk(message: Message, mut rest: &[u8], depth: usize, operators: &mut usize) -> Result<(), &'static str> {
    while !rest.is_empty() {
        let tag = number(&mut rest)?;
        match tag & 7 {
            0 => {
                number(&mut rest)?;
            }
            1 => {
                part(&mut rest, 8)?;
            }
            5 => {
                part(&mut rest, 4)?;
            }
            2 => {
                let length = number(&mut rest)?;
                let field = part(&mut rest, length)?;
                let Some(inside) = message.inside(tag >> 3) else { continue };
                *operators += usize::from(matches!(inside, Message::Operator));
                if *operators > OPERATORS {
                    return Err("more than 100000 operators");
                }
                walk(inside, field, depth.checked_sub(1).ok_or("messages that nest too deep")?, operators)?;
            }
            _ => return Err("a field of a kind that ONNX does not have"),
        }
    }
    Ok(())
}

/// Splits off the next `length` bytes.
fn part<'a>(rest: &mut &'a [u8], length: u64) -> Result<&'a [u8], &'static str> {
    let split = usize::try_from(length).ok().and_then(|length| rest.split_at_checked(length));
    let (part, after) = split.ok_or("a field that ends beyond what holds it")?;
    *rest = after;
    Ok(part)
}

/// The next variable-length integer, seven bits per byte.
fn number(rest: &mut &[u8]) -> Result<u64, &'static str> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let byte = part(rest, 1)?[0];
        value |= u64::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return Ok(value);
        }
    }
    Err("a number of more than 64 bits")
}
