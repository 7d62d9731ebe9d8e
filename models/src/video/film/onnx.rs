//! Whether bytes are built as an ONNX file is, before the runtime reads them.
//!
//! The runtime sets aside as many bytes as a field claims to have, and goes by recursion as deep as messages nest and as far as
//! operators follow each other: neither is left to a damaged file.

/// Messages nest at most so deep: those of one graph by six, and operators that hold graphs are few.
const DEPTH: usize = 48;

/// Most operators.
const OPERATORS: usize = 100_000;

/// The messages of an ONNX file that the runtime looks into.
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
    /// One that holds texts and numbers only.
    Plain,
}

impl Message {
    /// The message in a field of this number; `None` for texts, numbers and what is skipped.
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

/// Follows every message of an ONNX file.
///
/// # Errors
/// What is wrong with it: a field that ends beyond the message that it is in, one of a kind that ONNX does not have, too many operators,
/// or messages that nest too deep.
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

/// The next bytes, so many of them.
fn part<'a>(rest: &mut &'a [u8], length: u64) -> Result<&'a [u8], &'static str> {
    let split = usize::try_from(length).ok().and_then(|length| rest.split_at_checked(length));
    let (part, after) = split.ok_or("a field that ends beyond what holds it")?;
    *rest = after;
    Ok(part)
}

/// The next number, seven bits a byte.
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
