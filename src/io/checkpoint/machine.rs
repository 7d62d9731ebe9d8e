//! The stack machine of pickles, without the opcodes that reach outside of it.

use std::collections::HashMap;

use super::text;
use super::value::{Global, Graph, Id, Value};
use crate::{Error, ErrorKind, Result};

/// A pickle describes tensors; their numbers are elsewhere. One for 1 600 tensors has about 200 kB.
pub(super) const LARGEST_PICKLE: usize = 64 << 20;
/// Values that a pickle may build.
const MOST_VALUES: usize = 4 << 20;
/// Marks that may be open at once: lists within lists.
const MOST_MARKS: usize = 1 << 10;

/// Runs the pickle at the start of `bytes`; returns what it built and how long it was.
pub(super) fn run(bytes: &[u8]) -> Result<(Graph<'_>, usize)> {
    let cut = &bytes[..bytes.len().min(LARGEST_PICKLE)];
    let mut machine = Machine {
        bytes: cut,
        at: 0,
        opcode_at: 0,
        values: Vec::new(),
        stack: Vec::new(),
        marks: Vec::new(),
        memo: HashMap::new(),
        copied: 0,
    };
    loop {
        machine.opcode_at = machine.at;
        if let Some(top) = machine.step()? {
            return Ok((Graph { values: machine.values, top }, machine.at));
        }
    }
}

/// The state of a run.
pub(super) struct Machine<'a> {
    bytes: &'a [u8],
    at: usize,
    opcode_at: usize,
    pub values: Vec<Value<'a>>,
    stack: Vec<Id>,
    marks: Vec<usize>,
    memo: HashMap<u64, Id>,
    /// Items that were copied rather than moved off the stack.
    copied: usize,
}

impl<'a> Machine<'a> {
    /// Executes an opcode; returns the top value at the end.
    fn step(&mut self) -> Result<Option<Id>> {
        let [opcode] = self.take()?;
        let value = match opcode {
            b'.' => return self.pop().map(Some),
            0x80 => return self.protocol(),
            0x95 => return self.take::<8>().map(|_| None),
            b'N' => Value::None,
            0x88 => Value::Bool(true),
            0x89 => Value::Bool(false),
            b'J' => Value::Int(i32::from_le_bytes(self.take()?).into()),
            b'K' => Value::Int(u8::from_le_bytes(self.take()?).into()),
            b'M' => Value::Int(u16::from_le_bytes(self.take()?).into()),
            0x8a => self.long::<1>()?,
            0x8b => self.long::<4>()?,
            b'G' => Value::Float(f64::from_be_bytes(self.take()?)),
            b'I' => match self.line()? {
                "00" => Value::Bool(false),
                "01" => Value::Bool(true),
                text => self.whole(text)?,
            },
            b'L' => {
                let text = self.line()?;
                self.whole(text.strip_suffix('L').unwrap_or(text))?
            }
            b'F' => {
                let text = self.line()?;
                Value::Float(self.number(text)?)
            }
            b'X' => Value::Str(self.text::<4>()?),
            0x8c => Value::Str(self.text::<1>()?),
            0x8d => Value::Str(self.text::<8>()?),
            b'V' => match self.raw_line()? {
                plain if plain.is_ascii() && !plain.contains(&b'\\') => self.utf_8(plain).map(Value::Str)?,
                other => Value::Escaped(text::raw_unicode(other).into()),
            },
            b'S' => {
                let line = self.raw_line()?;
                let bytes = text::quoted(line).ok_or_else(|| self.fault("a text without its quotes"))?;
                let inside = line.trim_ascii().get(1..1 + bytes.len()).filter(|inside| **inside == *bytes);
                // text of Python 2, in an unknown encoding
                match (inside, String::from_utf8(bytes)) {
                    (Some(plain), Ok(_)) => self.utf_8(plain).map(Value::Str)?,
                    (None, Ok(text)) => Value::Escaped(text.into()),
                    (_, Err(_)) => Value::Bytes,
                }
            }
            b'B' => self.counted::<4>().map(|_| Value::Bytes)?,
            b'C' => self.counted::<1>().map(|_| Value::Bytes)?,
            0x8e | 0x96 => self.counted::<8>().map(|_| Value::Bytes)?,
            // text of Python 2, in an unknown encoding
            b'T' => bytes_or_text(self.counted::<4>()?),
            b'U' => bytes_or_text(self.counted::<1>()?),
            b'}' => Value::Dict(Vec::new()),
            b']' => Value::List(Vec::new()),
            b')' => Value::Tuple(Vec::new()),
            0x8f => Value::Set(Vec::new()),
            0x91 => Value::Set(self.since_mark()?),
            b't' => Value::Tuple(self.since_mark()?),
            b'l' => Value::List(self.since_mark()?),
            b'd' => {
                let items = self.since_mark()?;
                Value::Dict(self.pairs(&items)?)
            }
            0x85..=0x87 => {
                let start = self.stack.len().checked_sub(usize::from(opcode - 0x84)).ok_or_else(|| self.empty())?;
                self.above_mark(start)?;
                Value::Tuple(self.stack.split_off(start))
            }
            b'c' => {
                let (module, name) = (self.line()?, self.line()?);
                Value::Global(Box::new(Global { module, name }))
            }
            0x93 => {
                let (name, module) = (self.pop()?, self.pop()?);
                match (&self.values[module as usize], &self.values[name as usize]) {
                    (Value::Str(module), Value::Str(name)) => Value::Global(Box::new(Global { module, name })),
                    _ => return Err(self.fault("a global whose name is no text")),
                }
            }
            b'Q' => self.persistent()?,
            b'P' => self.persistent_text()?,
            _ => return self.rearrange(opcode).map(|()| None),
        };
        self.push(value)?;
        Ok(None)
    }

    /// The opcodes that leave no new value of their own.
    fn rearrange(&mut self, opcode: u8) -> Result<()> {
        match opcode {
            b'(' if self.marks.len() == MOST_MARKS => return Err(self.fault("values nested too deeply")),
            b'(' => self.marks.push(self.stack.len()),
            // at a mark, it is the mark that is dropped
            b'0' if self.marks.last() == Some(&self.stack.len()) => drop(self.marks.pop()),
            b'0' => drop(self.pop()?),
            b'1' => drop(self.since_mark()?),
            b'2' => {
                let top = *self.stack.last().ok_or_else(|| self.empty())?;
                self.stack.push(top);
            }
            b'q' => self.remember::<1>()?,
            b'r' => self.remember::<4>()?,
            b'h' => self.recall::<1>()?,
            b'j' => self.recall::<4>()?,
            b'p' => {
                let text = self.line()?;
                let index = self.number(text)?;
                self.memorise(index)?;
            }
            b'g' => {
                let text = self.line()?;
                let index = self.number(text)?;
                self.fetch(index)?;
            }
            0x94 => self.memorise(self.memo.len() as u64)?,
            b'a' => {
                let item = self.pop()?;
                self.append(&[item])?;
            }
            b'e' | 0x90 => {
                let items = self.since_mark()?;
                self.append(&items)?;
            }
            b's' => {
                let (value, key) = (self.pop()?, self.pop()?);
                self.set_items(&[key, value])?;
            }
            b'u' => {
                let items = self.since_mark()?;
                self.set_items(&items)?;
            }
            b'R' | 0x81 => {
                let (arguments, callee) = (self.pop()?, self.pop()?);
                let id = self.call(callee, arguments)?;
                self.stack.push(id);
            }
            b'i' => {
                let (module, name) = (self.line()?, self.line()?);
                let arguments = self.since_mark()?;
                self.make(Value::Global(Box::new(Global { module, name })), arguments)?;
            }
            b'o' => {
                let mut arguments = self.since_mark()?;
                if arguments.is_empty() {
                    return Err(self.empty());
                }
                let class = arguments.remove(0);
                let arguments = self.add(Value::Tuple(arguments))?;
                let id = self.call(class, arguments)?;
                self.stack.push(id);
            }
            0x82 => self.extension::<1>()?,
            0x83 => self.extension::<2>()?,
            0x84 => self.extension::<4>()?,
            // a buffer that is handed over beside the pickle, which a file does not have
            0x97 => {
                let id = self.opaque(Global { module: "pickle", name: "PickleBuffer" })?;
                self.stack.push(id);
            }
            // the same buffer, read-only
            0x98 => self.above_mark(self.stack.len().checked_sub(1).ok_or_else(|| self.empty())?)?,
            0x92 => {
                let (_, arguments, class) = (self.pop()?, self.pop()?, self.pop()?);
                let id = self.call(class, arguments)?;
                self.stack.push(id);
            }
            b'b' => {
                // the state of an object, or `_metadata` of an OrderedDict, which says nothing of tensors
                let state = self.pop()?;
                let object = *self.stack.last().ok_or_else(|| self.empty())?;
                match &mut self.values[object as usize] {
                    Value::Opaque(opaque) => opaque.states.push(state),
                    Value::Global(class) => {
                        let class = (**class).clone();
                        self.pop()?;
                        let id = self.opaque(class)?;
                        self.stack.push(id);
                    }
                    _ => {}
                }
            }
            _ => return Err(self.fault(&format!("the opcode {opcode:#04x}, which is not allowed"))),
        }
        Ok(())
    }

    fn protocol(&mut self) -> Result<Option<Id>> {
        match self.take()? {
            [0..=5] => Ok(None),
            [other] => Err(self.fault(&format!("pickle protocol {other}")).wanted("0 to 5")),
        }
    }

    /// A call whose parts are not on the stack.
    fn make(&mut self, class: Value<'a>, arguments: Vec<Id>) -> Result<()> {
        let (class, arguments) = (self.add(class)?, self.add(Value::Tuple(arguments))?);
        let id = self.call(class, arguments)?;
        self.stack.push(id);
        Ok(())
    }

    /// A class by its number in a registry of the program that wrote the file.
    fn extension<const N: usize>(&mut self) -> Result<()> {
        self.take::<N>()?;
        self.push(Value::Global(Box::new(Global { module: "copyreg", name: "extension" })))
    }

    fn append(&mut self, items: &[Id]) -> Result<()> {
        let target = *self.stack.last().ok_or_else(|| self.empty())?;
        match &mut self.values[target as usize] {
            Value::List(list) | Value::Set(list) => list.extend(items),
            Value::Opaque(object) => object.items.extend(items),
            other => {
                let found = format!("items added to {}", other.describe());
                return Err(self.fault(&found));
            }
        }
        Ok(())
    }

    fn set_items(&mut self, items: &[Id]) -> Result<()> {
        let pairs = self.pairs(items)?;
        let target = *self.stack.last().ok_or_else(|| self.empty())?;
        match &mut self.values[target as usize] {
            Value::Dict(dict) => dict.extend(pairs),
            Value::Opaque(object) => object.pairs.extend(pairs),
            other => {
                let found = format!("keys set in {}", other.describe());
                return Err(self.fault(&found));
            }
        }
        Ok(())
    }

    fn pairs(&self, items: &[Id]) -> Result<Vec<(Id, Id)>> {
        match items.as_chunks::<2>() {
            (pairs, []) => Ok(pairs.iter().map(|[key, value]| (*key, *value)).collect()),
            _ => Err(self.fault("a key without a value")),
        }
    }

    pub fn push(&mut self, value: Value<'a>) -> Result<()> {
        let id = self.add(value)?;
        self.stack.push(id);
        Ok(())
    }

    /// Puts a value into the arena.
    pub fn add(&mut self, value: Value<'a>) -> Result<Id> {
        if self.values.len() == MOST_VALUES {
            return Err(self.fault("too many values").wanted(format!("at most {MOST_VALUES}")));
        }
        self.values.push(value);
        Ok((self.values.len() - 1) as Id)
    }

    /// Accounts for items that a value takes from another one: a pickle may refer to a long list any number of times.
    pub fn copying(&mut self, items: usize) -> Result<()> {
        self.copied += items;
        if self.copied > 4 * self.bytes.len() {
            return Err(self.fault("values that repeat each other without end"));
        }
        Ok(())
    }

    pub fn pop(&mut self) -> Result<Id> {
        self.above_mark(self.stack.len().saturating_sub(1))?;
        self.stack.pop().ok_or_else(|| self.empty())
    }

    /// A mark is a floor: what lies below belongs to somebody else.
    fn above_mark(&self, start: usize) -> Result<()> {
        if self.marks.last().is_some_and(|mark| start < *mark) { Err(self.empty()) } else { Ok(()) }
    }

    fn since_mark(&mut self) -> Result<Vec<Id>> {
        let mark = self.marks.pop().ok_or_else(|| self.fault("the end of a group that never began"))?;
        Ok(self.stack.split_off(mark))
    }

    fn remember<const N: usize>(&mut self) -> Result<()> {
        let index = self.unsigned::<N>()?;
        self.memorise(index)
    }

    fn memorise(&mut self, index: u64) -> Result<()> {
        let top = *self.stack.last().ok_or_else(|| self.empty())?;
        self.memo.insert(index, top);
        Ok(())
    }

    fn recall<const N: usize>(&mut self) -> Result<()> {
        let index = self.unsigned::<N>()?;
        self.fetch(index)
    }

    fn fetch(&mut self, index: u64) -> Result<()> {
        let id = *self.memo.get(&index).ok_or_else(|| self.fault("a reference to a value that was never kept"))?;
        self.stack.push(id);
        Ok(())
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N]> {
        let bytes = self.bytes.get(self.at..).and_then(|rest| rest.first_chunk()).ok_or_else(|| self.cut_short())?;
        self.at += N;
        Ok(*bytes)
    }

    fn unsigned<const N: usize>(&mut self) -> Result<u64> {
        let bytes: [u8; N] = self.take()?;
        Ok(bytes.iter().rev().fold(0, |n, b| n << 8 | u64::from(*b)))
    }

    /// Bytes behind their number.
    fn counted<const N: usize>(&mut self) -> Result<&'a [u8]> {
        let len = usize::try_from(self.unsigned::<N>()?).map_err(|_| self.cut_short())?;
        let end = self.at.checked_add(len).filter(|end| *end <= self.bytes.len()).ok_or_else(|| self.cut_short())?;
        let bytes = &self.bytes[self.at..end];
        self.at = end;
        Ok(bytes)
    }

    fn text<const N: usize>(&mut self) -> Result<&'a str> {
        let bytes = self.counted::<N>()?;
        self.utf_8(bytes)
    }

    pub fn line(&mut self) -> Result<&'a str> {
        let line = self.raw_line()?;
        self.utf_8(line)
    }

    fn raw_line(&mut self) -> Result<&'a [u8]> {
        let rest = &self.bytes[self.at.min(self.bytes.len())..];
        let len = rest.iter().position(|b| *b == b'\n').ok_or_else(|| self.cut_short())?;
        self.at += len + 1;
        Ok(&rest[..len])
    }

    fn utf_8(&self, bytes: &'a [u8]) -> Result<&'a str> {
        str::from_utf8(bytes).map_err(|_| self.fault("text that is not UTF-8"))
    }

    /// An integer in digits, of any length.
    fn whole(&self, text: &'a str) -> Result<Value<'a>> {
        let text = text.trim();
        let digits = text.strip_prefix('-').unwrap_or(text);
        match text.parse() {
            Ok(small) => Ok(Value::Int(small)),
            Err(_) if !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit()) => Ok(Value::Digits(text)),
            Err(_) => Err(self.fault("a number that is none")),
        }
    }

    /// An integer of any length, little-endian in two's complement.
    fn long<const N: usize>(&mut self) -> Result<Value<'a>> {
        let bytes = self.counted::<N>()?;
        if bytes.len() > 8 {
            return Ok(Value::Big(bytes));
        }
        let sign = if bytes.last().is_some_and(|b| *b >= 0x80) { 0xff } else { 0 };
        let mut wide = [sign; 8];
        wide[..bytes.len()].copy_from_slice(bytes);
        Ok(Value::Int(i64::from_le_bytes(wide)))
    }

    fn number<T: std::str::FromStr>(&self, text: &str) -> Result<T> {
        text.trim().parse().map_err(|_| self.fault("a number that is none"))
    }

    pub fn count(&self, value: i64) -> Result<usize> {
        usize::try_from(value).map_err(|_| self.fault(&format!("{value} for a size, stride, offset or length")))
    }

    pub fn fault(&self, found: &str) -> Error {
        Error::new(ErrorKind::Input, "the pickle of the checkpoint is refused")
            .at(format!("byte {}", self.opcode_at))
            .found(found)
            .fix("copy or download the file again, or save its tensors alone: torch.save(model.state_dict(), \"weights.pt\")")
    }

    fn empty(&self) -> Error {
        self.fault("an operation on an empty stack")
    }

    fn cut_short(&self) -> Error {
        self.fault(&format!("an end at byte {}, before the pickle's own", self.bytes.len()))
            .wanted(format!("a whole pickle of at most {} MiB", LARGEST_PICKLE >> 20))
    }
}

fn bytes_or_text(bytes: &[u8]) -> Value<'_> {
    str::from_utf8(bytes).map_or(Value::Bytes, Value::Str)
}
