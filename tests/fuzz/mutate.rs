//! Damage that keeps much of a file intact.

use gradreel::Key;

/// What a pickle is made of.
pub const OPCODES: [&[u8]; 34] = [
    b"\x80\x02",
    b"(",
    b"t",
    b"}",
    b"]",
    b")",
    b"R",
    b"Q",
    b"b",
    b"u",
    b"s",
    b"a",
    b"e",
    b"0",
    b"2",
    b"N",
    b"\x85",
    b"\x87",
    b"h\x00",
    b"q\x01",
    b"K\xff",
    b"\x8a\x08\xff\xff\xff\xff\xff\xff\xff\x7f",
    b"J\xff\xff\xff\xff",
    b"ctorch._utils\n_rebuild_tensor_v2\n",
    b"Vw\n",
    b"S'w'\n",
    b"I1\n",
    b"L12L\n",
    b"P('storage', <class 'torch.FloatStorage'>, '0', 'cpu', 30)\n",
    b"(ia\nb\n",
    b"o",
    b"\x81",
    b"\x91",
    b"\x94",
];

/// What texts are made of, and their numbers.
pub const TEXTS: [&[u8]; 22] = [
    b"\xef\xbb\xbf",
    b"\n",
    b"\r\n",
    b"\\\n",
    b"#",
    b"\"",
    b"[",
    b"]",
    b"{",
    b"}",
    b",",
    b"=",
    b"null",
    b"true",
    b"../",
    b"/",
    b" ",
    b"\0",
    b"1 2 3",
    b"\xff",
    b"\xc3\xa9",
    b"\"\"",
];

/// Numbers that a reader may not expect.
const NUMBERS: [&str; 20] = [
    "0",
    "-0.0",
    "-1",
    "1",
    "2",
    "1e308",
    "-1e308",
    "1e-308",
    "1e400",
    "1e30",
    "nan",
    "inf",
    "-inf",
    "255",
    "65536",
    "2147483648",
    "4294967295",
    "9223372036854775807",
    "18446744073709551615",
    "0.1",
];

/// The same in bytes.
const WORDS: [u32; 10] =
    [0, 1, 0x7f, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 0x7f80_0000, 0xff80_0000, 0x7fc0_0000, 0x7149_f2ca];

/// Numbers from a seed, one after the other.
pub struct Mutator {
    key: Key,
    drawn: u64,
}

impl Mutator {
    pub fn new(seed: u64, run: u64) -> Self {
        Self { key: Key::new(seed).fold(run), drawn: 0 }
    }

    fn below(&mut self, bound: usize) -> usize {
        self.drawn += 1;
        self.key.fold(self.drawn).below(bound.max(1), 1).next().expect("one number")
    }

    /// A file of the corpus with one to eight injuries.
    pub fn mutate(&mut self, corpus: &[Vec<u8>], tokens: &[&[u8]]) -> Vec<u8> {
        let mut file = corpus[self.below(corpus.len())].clone();
        for _ in 0..[1, 1, 1, 2, 2, 3, 5, 8][self.below(8)] {
            self.injure(&mut file, corpus, tokens);
        }
        file
    }

    fn injure(&mut self, file: &mut Vec<u8>, corpus: &[Vec<u8>], tokens: &[&[u8]]) {
        if file.is_empty() {
            return;
        }
        let at = self.below(file.len());
        let len = (1 + self.below(16)).min(file.len() - at);
        match self.below(14) {
            0 => file[at] ^= 1 << self.below(8),
            1 => file[at] = self.below(256) as u8,
            2 => file[at..at + len].fill([0, 0x7f, 0xff][self.below(3)]),
            3 => drop(file.drain(at..at + len)),
            4 => {
                let piece = file[at..at + len].repeat(1 + self.below(40));
                file.splice(at..at, piece);
            }
            5 => {
                let token = tokens[self.below(tokens.len())];
                file.splice(at..at, token.iter().copied());
            }
            6 => {
                let token = tokens[self.below(tokens.len())];
                let end = (at + token.len()).min(file.len());
                file.splice(at..end, token.iter().copied());
            }
            7 => {
                let other = &corpus[self.below(corpus.len())];
                let from = self.below(other.len());
                let piece = &other[from..(from + 64).min(other.len())];
                let end = (at + piece.len()).min(file.len());
                file.splice(at..end, piece.iter().copied());
            }
            8 if self.below(4) == 0 => file.truncate(at),
            9 | 10 => self.renumber(file, at),
            11 => {
                let word = WORDS[self.below(WORDS.len())];
                let word = if self.below(2) == 0 { word.to_le_bytes() } else { word.to_be_bytes() };
                let end = (at + 4).min(file.len());
                file[at..end].copy_from_slice(&word[..end - at]);
            }
            12 => self.reline(file, at),
            13 if self.below(8) == 0 => drop(file.splice(0..0, *b"\xef\xbb\xbf")),
            _ => {
                let small = self.below(20) as u8;
                file[at] = file[at].wrapping_add(small);
            }
        }
    }

    /// Another number in the place of the next one that is written in digits.
    fn renumber(&mut self, file: &mut Vec<u8>, at: usize) {
        let is_part = |byte: &u8| byte.is_ascii_digit() || matches!(byte, b'.' | b'-' | b'+');
        let Some(start) = file[at..].iter().position(u8::is_ascii_digit).map(|first| at + first) else { return };
        let start = start - file[..start].iter().rev().take_while(|byte| is_part(byte)).count();
        let end = start + file[start..].iter().take_while(|byte| is_part(byte)).count();
        let number = NUMBERS[self.below(NUMBERS.len())];
        file.splice(start..end, number.bytes());
    }

    /// The line at a place twice, not at all, or instead of another one.
    fn reline(&mut self, file: &mut Vec<u8>, at: usize) {
        let line = |file: &[u8], at: usize| {
            let start = file[..at].iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
            start..file[at..].iter().position(|byte| *byte == b'\n').map_or(file.len(), |end| at + end + 1)
        };
        let here = line(file, at);
        if here.len() > 4096 {
            return;
        }
        let text = file[here.clone()].to_vec();
        match self.below(3) {
            0 => drop(file.drain(here)),
            1 => drop(file.splice(here.start..here.start, text)),
            _ => {
                let there = line(file, self.below(file.len()));
                file.splice(there, text);
            }
        }
    }
}
